"""Laws that no machine has, offered beside the real ones in blind campaigns: is one named?

Campaigns as in the blind benchmark (MuJoCo, unknown nuisances, wrong beliefs), one for each real effect and some with nothing
hidden; the diagnosis is given the catalogue and the decoys. And each decoy hidden in turn, to show that it could be named.
"""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

from analysis.diagnose import diagnose
from analysis.diagnosis import Diagnosis
from analysis.observed import observe
from testbed.effect import DECOYS, catalogue
from testbed.engines import predict
from tests.validation.blind.draw import SINGLES, draw
from tests.validation.blind.make import records_of
from tests.validation.claims import Claim, Section

EVERY = catalogue(DECOYS)
NAMES = tuple(sorted(set(EVERY) - set(catalogue())))
PLANT = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=EVERY),
                        predict_driven=partial(predict.predict_driven, catalogue=EVERY))
FIRST, EMPTY = 7000, 4  # the first seed, and campaigns with nothing hidden


def told(seed: int, names: tuple[str, ...]) -> Diagnosis:
    """The diagnosis, with decoys offered, of the campaign of a seed."""
    truth = draw(seed, EVERY, kind=None if names else "none", names=names or None)
    records = [observe(record, truth.believed) for record in records_of(truth, EVERY)]
    return diagnose(PLANT, records, truth.believed, EVERY)


def check() -> Section:
    """One campaign of each real effect, some of none, one of each decoy."""
    rows, named, real, found_decoys = [], 0, 0, 0
    hidden = [*((name,) for name in SINGLES), *((),) * EMPTY, *((name,) for name in NAMES)]
    for number, names in enumerate(hidden):
        found = told(FIRST + number, names)
        decoy = bool(names) and names[0] in NAMES
        caught = [name for name in found.effects if name in NAMES]
        if decoy:
            found_decoys += found.effects == names
        else:
            real += 1
            named += bool(caught)
        rows.append((str(FIRST + number), " + ".join(names) or "nothing", found.verdict, " + ".join(found.effects) or "none",
                     f"{found.baseline / found.noise_floor:.3f}", f"{found.with_effects / found.noise_floor:.3f}"))
    return Section(
        "Decoys: laws that no machine has, offered beside the real ones",
        (Claim("campaigns of real effects, or of none, in which a decoy is named", "0", f"{named} of {real}", not named),
         Claim("a decoy that is hidden is found", "told", f"{found_decoys} of {len(NAMES)}", None)),
        (("Campaign by campaign", ("seed", "hidden", "verdict", "named", "error / noise before", "after"), tuple(rows)),),
    )
