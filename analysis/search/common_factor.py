"""A condition that was written down wrongly in all records alike: would another feed, flute number, speed or rate explain them?

A slip of the pen bends every parameter and looks like missing physics. Each of the usual ones (a feed a revolution as one a
tooth, an insert taken out, inches for millimetres, rad/s for rpm, another sampling rate) is a hypothesis of its own without a
single unknown more: the believed model is fitted to the records as they would then be. First the openings alone, then in full
where that explains far more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from analysis.fit.effect_start import all_free
from analysis.fit.evidence import DELTA_BIC, bic, effective_size
from analysis.fit.observed import Observed, heard_in
from analysis.fit.prediction import Plant
from analysis.fit.starts import glance
from analysis.fit.structure_start import structure_start
from analysis.search.begun_anew import from_believed
from analysis.search.diagnosis import ADEQUATE, Candidate
from testbed.effect import Effect
from testbed.machine import Model

TWICE = (2.0, 0.5)  # a radius for a diameter, both sides of a slot, peak to peak
TENFOLD = (10.0, 0.1)  # a decimal point
INCH = (25.4, 1 / 25.4)  # in mm
PER_MINUTE = (60.0, 1 / 60.0)
RAD_PER_RPM = 2.0 * math.pi / 60.0
MAINS = (1.2, 1 / 1.2)  # a spindle at 60 Hz for 50
RATES = (1.25, 1.28, 1.6, 2.0, 2.5, 4.0, 5.0, 10.0)  # of one usual sampling rate to another
MOST_FLUTES = 8  # that are tried
FASTEST, SLOWEST = 2e4, 0.5  # rad/s, that a spindle turns at
BETTER = 0.7  # share of the cost of the openings, as stated, that another statement must leave to be fitted in full,
FITTED = 2  # the best so many of them
PLAINLY = 3.0  # error over noise floor from which a statement that leaves but noise is believed before effects are tried
ALIKE = 1e-3  # relative difference below which two factors are one


@dataclass(frozen=True)
class Restated:
    """The campaign with one condition stated otherwise: which, true over stated (flutes: the number), records and model."""

    condition: str
    factor: float
    records: Sequence[Observed]
    model: Model
    told: str

    @property
    def sentence(self) -> str:
        """In words, what is to be checked."""
        return f"The records agree with the model down to their noise {self.told}: check what was written down; no effect is needed."


def restatements(records: Sequence[Observed], model: Model) -> Iterator[Restated]:
    """The usual ways in which one condition of all cuts may have been written down wrongly."""
    if model.cutter is None or all(record.cut is None for record in records):
        return
    flutes = model.cutter.flutes
    own = (float(flutes), 1.0 / flutes)

    def of(condition: str, factor: float, told: str, *, teeth: int = flutes, feed: float = 1.0) -> Restated:
        changed = [record if record.cut is None else _restated(record, condition, factor, teeth, feed) for record in records]
        machine = replace(model, cutter=replace(model.cutter, flutes=teeth))
        return Restated(condition, factor, changed, machine, told)

    for factor in _distinct((*own, *TWICE, *TENFOLD, *INCH, *PER_MINUTE)):
        slip = " (a feed per revolution written as per tooth, or the other way round?)" if flutes > 1 and _is(factor, own) else ""
        yield of("feed", factor, f"if the feed per tooth was {_times(factor)} the stated one in all records{slip}, or the "
                                 f"channel of motion reads {_times(1.0 / factor)} what it should")
    for teeth in range(1, min(MOST_FLUTES, max(6, 2 * flutes)) + 1):
        for feed in _distinct((flutes / teeth,), also=1.0) if teeth != flutes else ():
            rest = "" if feed == 1.0 else f" and {_times(feed)} the stated feed per tooth (the same feed per revolution)"
            yield of("flutes", teeth, f"if {teeth} {'flute' if teeth == 1 else 'flutes'} cut, not {flutes}{rest}",
                     teeth=teeth, feed=feed)
    if any(_marked(record) for record in records):
        return  # marks that contradict the stated speed are told where the records are read
    for factor in _distinct((*TWICE, *MAINS, RAD_PER_RPM, 1.0 / RAD_PER_RPM, *PER_MINUTE, *own)):
        if all(SLOWEST < factor * one.cut.spindle_speed < FASTEST for one in records if one.cut is not None):
            yield of("speed", factor, f"if the spindle speed was {_times(factor)} the stated one in all records")
    for factor in _distinct((*RATES, *(1.0 / one for one in RATES))):
        yield of("rate", factor, f"if the sampling rate was {_times(factor)} the stated one")


def _distinct(factors: Sequence[float], also: float | None = None) -> list[float]:
    """The factors, each once, and without that which changes nothing unless it is asked for `also`."""
    found: list[float] = [] if also is None else [also]
    for factor in factors:
        if abs(factor - 1.0) > ALIKE and not _is(factor, found):
            found.append(factor)
    return found


def _is(factor: float, some: Sequence[float]) -> bool:
    return any(abs(factor / one - 1.0) < ALIKE for one in some)


def _times(factor: float) -> str:
    """A factor in words: as a plain fraction where it is one."""
    if _is(round(1.0 / factor), (1.0 / factor,)) and factor < 1.0:
        return f"1/{round(1.0 / factor)} of"
    return f"{factor:.4g} times"


def _marked(record: Observed) -> bool:
    return record.first_mark is not None or record.steady_marks is not None


def _restated(record: Observed, condition: str, factor: float, flutes: int, feed: float) -> Observed:
    """A cut with one condition stated otherwise; its speed is heard again where that decides by which lines."""
    assert record.cut is not None
    if condition == "feed":
        return replace(record, cut=replace(record.cut, feed_per_tooth=factor * record.cut.feed_per_tooth))
    cut = replace(record.cut, feed_per_tooth=feed * record.cut.feed_per_tooth)
    if condition == "speed":
        travels = 1.0 if record.feed_basis == "tooth" else 1.0 / factor
        cut = replace(cut, spindle_speed=factor * cut.spindle_speed, feed_per_tooth=travels * cut.feed_per_tooth)
    changed = replace(record, cut=cut, flutes=flutes)
    if condition == "rate":
        segments = tuple(replace(one, start=one.start / factor, stop=one.stop / factor) for one in record.segments)
        changed = replace(changed, rate=factor * record.rate, start=record.start / factor, segments=segments)
    if _marked(record):
        return changed
    return replace(changed, period=2.0 * math.pi / (heard_in(changed, cut.spindle_speed, flutes) or cut.spindle_speed))


def explained_otherwise(
    base: Candidate, model: Model, catalogue: Mapping[str, Effect], say: Callable[[str], None] = lambda text: None
) -> tuple[Restated, Candidate] | None:
    """(the statement, its fit) by which the believed `model` leaves but noise of the records, the likeliest; None without one.

    base: the model fitted to the records as they are stated.
    """
    assert base.fitter is not None and base.fit is not None
    plant, records = base.fitter.plant, base.fitter.records
    stated = _opening(plant, records, model, catalogue)
    say("looking at conditions that may have been written down wrongly")
    costs = [(_opening(plant, one.records, one.model, catalogue), number, one)
             for number, one in enumerate(restatements(records, model))]
    best = None
    for cost, _, one in sorted(costs)[:FITTED]:
        if cost > BETTER * stated:
            break
        say(f"fitting the model {one.told}")
        found = from_believed(plant, one.records, one.model, (), catalogue)
        if best is None or found.error_where_known < best[1].error_where_known:
            best = one, found
    if best is None or best[1].error_where_known > ADEQUATE * _noise(best[1]):
        return None
    return best


def _noise(one: Candidate) -> float:
    from analysis.fit.held_out import pooled

    return pooled(one.errors)[1]


def likelier(restated: Candidate, named: Candidate) -> bool:
    """Whether a statement that leaves but noise explains as much as the effects that are `named`, which cost unknowns."""
    assert restated.fit is not None and named.fit is not None
    size = effective_size(named.fit)
    return bic(restated.fit, size) < bic(named.fit, size) + DELTA_BIC


def _opening(plant: Plant, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect]) -> float:
    """What a model leaves of the records' openings, as a cost: little work beside a whole fit."""
    return glance(plant, records, structure_start(records, model), all_free(records, model, catalogue))
