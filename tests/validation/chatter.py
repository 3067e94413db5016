"""Did it chatter? Random cuts judged from their records alone, against the multipliers; and the classes of exported runs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

from testbed.analysis.multipliers.run_labels import observed
from testbed.analysis.records.record_report import RecordReport, report
from tests.validation.chatter_cuts import KINDS, Drawn, accelerated, draw
from tests.validation.claims import Claim, Section
from tests.validation.noisy_cuts import draw as noisy_cut

DRAWS, FIRST = 300, 97_000  # the judge was made on other seeds
NOISY = 120  # stable cuts whose force is noisy
RUNS = 90  # of data sets with an accelerometer alone
REMARK = """The classes are of the multipliers by Chebyshev collocation, |mu| below 0.95 or above 1.05; the motion is the fast
engine's, with contact loss. Stable cuts that the blow of the entry throws into lasting chatter are left out. A saddle-node does
not occur: a perturbation that repeats with the delay changes no chip, so a multiplier 1 would need an undamped structure. A
flip that has grown often goes on to another rhythm, and the record shows that one: the kind told is of the record's end.
The judge was made on other cuts; these were judged twice, before and after its last change. The kind is told by how
the motion grew where that was recorded, else by the place of the line; no kind is told where that may be either's."""
VERDICTS = ("chatter", "none", "unknown")


def _right(drawn: Drawn, verdict: str) -> bool:
    return verdict == ("none" if drawn.truth == "stable" else "chatter")


def _rows(title: str, judged: list[tuple[Drawn, str, str | None]], of: Callable[[Drawn], str]) -> list[tuple[str, ...]]:
    rows = []
    for value in sorted({of(drawn) for drawn, _, _ in judged}):
        some = [one for one in judged if of(one[0]) == value]
        said = Counter(verdict for _, verdict, _ in some)
        right = sum(_right(drawn, verdict) for drawn, verdict, _ in some)
        rows.append((title, value, str(len(some)), str(right), *(str(said[one]) for one in VERDICTS)))
    return rows


def _named_hum(found: RecordReport, frequency: float | None) -> bool:
    """Whether the line that is chatter stands among the record's lines as hum or the structure's own."""
    near = [line for line in found.lines if frequency and abs(line.frequency - frequency) < 0.005 * frequency]
    return bool(near) and min(near, key=lambda line: abs(line.frequency - (frequency or 0.0))).kind in ("hum", "natural")


def _exported(runs: int) -> tuple[int, int, int]:
    """(right, undecided, wrong) of stable or not, by the `behaviour` of runs with an accelerometer alone."""
    right = undecided = 0
    for seed in range(runs):
        kind = KINDS[seed % len(KINDS)]
        run, noise = accelerated(FIRST + seed, kind)
        found = observed(run, {"acceleration": noise})
        undecided += found == "undecided"
        right += found != "undecided" and (found == "stable") == (kind == "stable")
    return right, undecided, runs - right - undecided


def _alarms(draws: int) -> int:
    """How many stable cuts with a noisy force are called chatter."""
    found = (report(noisy_cut(FIRST + seed), str(seed), "cut", ()).chatter for seed in range(draws))
    return sum(one is not None and one.verdict == "chatter" for one in found)


def check(draws: int = DRAWS, runs: int = RUNS, noisy: int = NOISY) -> Section:
    """The section of the table."""
    judged: list[tuple[Drawn, str, str | None]] = []
    kinds: Counter[tuple[str, str, str]] = Counter()
    hum = 0
    for seed in range(FIRST, FIRST + draws):
        drawn = draw(seed, KINDS[seed % len(KINDS)])
        found = report(drawn.recording, str(seed), "cut", ())
        assert found.chatter is not None
        judged.append((drawn, found.chatter.verdict, found.chatter.kind))
        kinds[drawn.truth, found.chatter.verdict, str(found.chatter.kind)] += 1
        if drawn.truth != "stable":
            hum += _named_hum(found, found.chatter.frequency)
    right = sum(_right(drawn, verdict) for drawn, verdict, _ in judged)
    open_kind = sum(drawn.truth == "flip" and drawn.flutes % 2 == 0 and verdict == "unknown" and kind == "flip_or_runout"
                    for drawn, verdict, kind in judged)  # fmt: skip
    unknown = sum(verdict == "unknown" for _, verdict, _ in judged)
    wrong = draws - right - unknown
    good, undecided, bad = _exported(runs)
    alarms = _alarms(noisy)
    rows = [*_rows("true class", judged, lambda one: one.truth), *_rows("channel", judged, lambda one: one.channel),
            *_rows("flutes", judged, lambda one: str(one.flutes)), *_rows("tachometer", judged, lambda one: str(one.marks)),
            *_rows("idling before", judged, lambda one: str(one.idle)), *_rows("hum", judged, lambda one: str(one.hum)),
            *_rows("runout", judged, lambda one: str(one.runout))]  # fmt: skip
    return Section("Did it chatter?", (
        Claim(f"{draws} cuts away from the border: chatter or not, as the multipliers say", ">= 98 %",
              f"{100 * right / draws:.1f} %", right >= 0.98 * draws, f"{unknown} not known, {wrong} wrong"),
        Claim("the same, a flip of an even number of flutes left open (`flip_or_runout`) counted as right", ">= 98 %",
              f"{100 * (right + open_kind) / draws:.1f} %", right + open_kind >= 0.98 * draws, f"{open_kind} left open"),
        Claim("the same: a wrong verdict", "<= 1 %", f"{100 * wrong / draws:.1f} %", wrong <= 0.01 * draws),
        Claim("chatter line named hum or natural", "0", str(hum), hum == 0),
        Claim(f"{noisy} stable cuts whose force is noisy (3 to 100 % of itself from step to step): called chatter", "<= 2 %",
              f"{alarms} of {noisy}", alarms <= 0.02 * noisy),
        Claim(f"{runs} runs with an accelerometer alone: `behaviour` of the export is wrong about stable or not", "<= 2 %",
              f"{100 * bad / runs:.1f} %", bad <= 0.02 * runs, f"{good} right, {undecided} undecided"),
    ), (("Verdicts", ("by", "", "cuts", "right", *VERDICTS), tuple(rows)),
        ("Kinds", ("true class", "verdict", "kind told", "cuts"),
         tuple((*key, str(count)) for key, count in sorted(kinds.items()))),
    ), REMARK)
