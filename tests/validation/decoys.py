"""Laws that no machine has, offered beside the real ones in blind campaigns: is one named?

Campaigns as in the blind benchmark (MuJoCo, unknown nuisances, wrong beliefs), one for each real effect and some with nothing
hidden; the diagnosis is given the catalogue and the decoys. And decoys hidden in turn, to show that they could be named.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor

from testbed.analysis.fit.observe import observe
from testbed.analysis.search.diagnose import diagnose
from testbed.api.fitting import plant_of
from testbed.catalogue import DECOYS, catalogue
from tests.validation.blind.draw import SINGLES, draw
from tests.validation.blind.make import records_of
from tests.validation.claims import Claim, Section

EVERY = catalogue(DECOYS)
NAMES = tuple(sorted(set(EVERY) - set(catalogue())))
PLANT = plant_of(EVERY)
FIRST, EMPTY = 7000, 4  # the first seed, and campaigns with nothing hidden
WORKERS = 2
HIDDEN = tuple(name for name in NAMES if name != "decoy_ripple")  # hidden, it is so stiff that a diagnosis takes very long


def told(job: tuple[int, tuple[str, ...]]) -> tuple[str, tuple[str, ...], float, float]:
    """(verdict, named, error / noise before, after) of the campaign of a seed with these effects hidden, decoys offered."""
    seed, names = job
    truth = draw(seed, EVERY, kind=None if names else "none", names=names or None)
    records = [observe(record, truth.believed) for record in records_of(truth, EVERY)]
    found = diagnose(PLANT, records, truth.believed, EVERY)
    print(f"decoys: {seed} {' + '.join(names) or 'nothing'} -> {found.verdict} {' + '.join(found.effects)}", flush=True)
    return found.verdict, found.effects, found.baseline / found.noise_floor, found.with_effects / found.noise_floor


def check() -> Section:
    """One campaign of each real effect, some of none, one of each decoy but the stiffest."""
    hidden = [*((name,) for name in SINGLES), *((),) * EMPTY, *((name,) for name in HIDDEN)]
    with ProcessPoolExecutor(WORKERS) as pool:
        answers = list(pool.map(told, list(enumerate(hidden, FIRST))))
    both = list(zip(hidden, answers, strict=True))
    split = len(hidden) - len(HIDDEN)
    real, decoys = [named for _, (_, named, *_) in both[:split]], [named == names for names, (_, named, *_) in both[split:]]
    fooled = [named for named in real if set(named) & set(NAMES)]
    rows = tuple((str(seed), " + ".join(names) or "nothing", verdict, " + ".join(named) or "none", f"{before:.3f}",
                  f"{after:.3f}") for seed, (names, (verdict, named, before, after)) in enumerate(both, FIRST))
    return Section(
        "Decoys: laws that no machine has, offered beside the real ones",
        (Claim("campaigns of real effects, or of none, in which a decoy is named", "0", f"{len(fooled)} of {len(real)}",
               not fooled),
         Claim("a decoy that is hidden is found", "told", f"{sum(decoys)} of {len(decoys)}", None)),
        (("Campaign by campaign", ("seed", "hidden", "verdict", "named", "error / noise before", "after"), rows),),
    )
