"""A condition that was written down wrongly in all records alike: would another feed, flute number, speed or rate explain them?
Of a machine in x and y, too: channels, modes or teeth, see `planar_slips`.

A slip of the pen bends every parameter and looks like missing physics. Each of the usual ones (a feed a revolution as one a
tooth, an insert taken out, inches for millimetres, rad/s for rpm, another sampling rate) is a hypothesis of its own without a
single unknown more: the believed model is fitted to the records as they would then be. First the openings alone, then in full
where that explains far more.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.fit.effect_start import all_free
from testbed.analysis.fit.evidence import DELTA_BIC, bic, effective_size
from testbed.analysis.fit.fit_state import FreeParameter
from testbed.analysis.fit.held_out import pooled
from testbed.analysis.fit.identifiable import identifiable_parameters
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import heard_in
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.plausible import unlike_a_machine
from testbed.analysis.fit.prediction import Engine
from testbed.analysis.fit.starts import glance, noise_of_openings
from testbed.analysis.fit.structure_start import structure_start
from testbed.analysis.search.candidate import ADEQUATE, Candidate
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.analysis.search.planar_slips import planar_slips
from testbed.analysis.search.refit_from_prior import from_believed
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
BETTER = 0.8  # share of the cost of the openings, as stated, that another statement must leave to be fitted in full,
FITTED = 3  # the best so many of them
WORTH = 0.5  # share of the cost of the fit as stated, above which a statement is given up, unless a
OFF_COURSE = 100.0  # mean square residual is no more than a record a pass off its course would leave, which is found last
RINGS = 0.1  # relative difference of the natural frequency, within which the sampling rate is not doubted
PLAINLY = 3.0  # error over noise floor from which a statement that leaves but noise is believed before effects are tried
FAR, NEARLY = 10.0, 1.05  # and that from which one is believed that leaves so much: a thousandth of the power beyond the noise
SLIPS = 0.02  # of the speed, that a log book is off
ALIKE = 1e-3  # relative difference below which two factors are one
OF_KIND = ("channels", "sign", "carrier", "direction", "milling")  # statements that no strength of an effect is like
OF_THE_REST = 0.3  # share of what the openings leave beyond noise that a statement may leave there to be fitted to all: with
# so many unknowns and statements some always seem better
GLANCED = 2  # records of a machine in x and y whose openings tell which statements are fitted to all


@dataclass(frozen=True)
class Restated:
    """The campaign with one condition stated otherwise: which, true over stated (flutes: the number; 1 where it is no factor),
    records and model. more: what is unknown besides. said: `told` by the model as it is then fitted. nearly: little more than
    noise is left."""

    condition: str
    factor: float
    records: Sequence[Observed]
    model: Model
    told: str
    more: tuple[FreeParameter, ...] = ()
    said: Callable[[Model], str] | None = None
    nearly: bool = False

    @property
    def of_kind(self) -> bool:
        """Whether the statement is one of kind, without a number that could make up for an effect."""
        return self.condition in OF_KIND

    @property
    def sentence(self) -> str:
        """In words, what is to be checked."""
        down = "nearly down to their noise" if self.nearly else "down to their noise"
        return f"The records agree with the model {down} {self.told}: check what was written down. No effect is needed then."


def restatements(records: Sequence[Observed], model: Model) -> Iterator[Restated]:
    """The usual ways in which one condition of all cuts may have been written down wrongly."""
    for one in planar_slips(records, model) if model.planar else ():
        yield Restated(one.condition, 1.0, one.records, one.model, one.said(one.model), one.more, one.said)
    if model.cutter is None or all(record.cut is None for record in records):
        return
    cutter, flutes = model.cutter, model.cutter.flutes
    own = (float(flutes), 1.0 / flutes)

    def of(condition: str, factor: float, told: str, *, teeth: int = flutes, feed: float = 1.0) -> Restated:
        changed = [record if record.cut is None else _restated(record, condition, factor, teeth, feed) for record in records]
        machine = model if teeth == flutes else replace(model, cutter=replace(cutter, flutes=teeth, pitch_angles=()))
        return Restated(condition, factor, changed, machine, told)

    for factor in _distinct((*own, *TWICE, *TENFOLD, *INCH, *PER_MINUTE)):
        slip = " (a feed per revolution written as per tooth, or the reverse?)" if flutes > 1 and _is(factor, own) else ""
        yield of("feed", factor, f"if the feed per tooth was {_times(factor)} the stated one in all records{slip}, or the "
                                 f"channel of motion reads {_times(1.0 / factor)} what it should")
    for teeth in range(1, min(MOST_FLUTES, max(6, 2 * flutes)) + 1):
        for feed in _distinct((flutes / teeth,), also=1.0) if teeth != flutes else ():
            rest = "" if feed == 1.0 else f" and {_times(feed)} the stated feed per tooth (the same feed per revolution)"
            yield of("flutes", teeth, f"if {teeth} {'flute' if teeth == 1 else 'flutes'} cut, not {flutes}{rest}",
                     teeth=teeth, feed=feed)
    if any(_marked(record) for record in records):
        return  # marks that contradict the stated speed are told where the records are read
    heard = all(heard_in(record, record.cut.spindle_speed, flutes) for record in records if record.cut is not None)
    for factor in _distinct((*TWICE, *MAINS, RAD_PER_RPM, 1.0 / RAD_PER_RPM, *PER_MINUTE, *own)):
        if _told_by_lines(factor, heard):
            continue
        if all(SLOWEST < factor * one.cut.spindle_speed < FASTEST for one in records if one.cut is not None):
            yield of("speed", factor, _told_clock("speed", factor))
    rung = zip(structure_start(records, model).structure.modes, model.structure.modes, strict=True)
    if all(abs(math.log(seen.natural_frequency / one.natural_frequency)) < RINGS for seen, one in rung):
        return  # the free decays keep the time that the model keeps
    for factor in _distinct((*RATES, *(1.0 / one for one in RATES))):
        if not _told_by_lines(factor, heard):
            yield of("rate", factor, _told_clock("rate", factor))


def _distinct(factors: Sequence[float], also: float | None = None) -> list[float]:
    """The factors, each once, and without that which changes nothing unless it is asked for `also`."""
    found: list[float] = [] if also is None else [also]
    for factor in factors:
        if abs(factor - 1.0) > ALIKE and not _is(factor, found):
            found.append(factor)
    return found


def _told_by_lines(factor: float, heard: bool) -> bool:
    """Whether lines of the tooth's passing, where they are heard, would contradict a factor: not one of harmonics."""
    return heard and not any(_is(max(factor, 1.0 / factor), (float(order),)) for order in range(2, MOST_FLUTES + 3))


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
    base: Candidate, model: Model, catalogue: Mapping[str, Effect], progress: Callable[[str], None] = lambda text: None
) -> tuple[Restated, Candidate] | None:
    """(the statement, its fit) by which the believed `model` leaves but noise of the records, the likeliest; None without one.

    base: the model fitted to the records as they are stated.
    """
    engine, records = base.fitter.engine, base.fitter.records
    misfit = base.error_where_known / pooled(base.errors)[1]
    if misfit <= ADEQUATE:
        return None
    enough = NEARLY if misfit > FAR else ADEQUATE
    progress("looking at conditions that may have been written down wrongly")
    places = range(len(records)) if not model.planar else _some(records)
    unknown = base.fitter.unknowns if model.planar else all_free(records, model, catalogue)

    def opening(stated: Sequence[Observed], machine: Model, more: Sequence[FreeParameter] = ()) -> float:
        """What a model leaves of the records' openings, as a cost: little work beside a whole fit."""
        asked = [stated[place] for place in places]
        return glance(engine, asked, structure_start(asked, machine), [*unknown, *more])

    stated = opening(records, model)
    costs = [(opening(one.records, one.model, one.more), number, one)
             for number, one in enumerate(restatements(records, model))]
    if not costs:
        return None
    noise = noise_of_openings([records[place] for place in places])
    most = noise + OF_THE_REST * max(stated - noise, 0.0) if model.planar else BETTER * stated
    likely = [one for one in sorted(costs)[:FITTED] if one[0] <= most]
    shown = [one for one in costs if shown_by_lines(one[2], base, model) and one not in likely]
    for _, _, one in (*shown, *likely):
        progress(f"fitting the model {one.told}")
        cost_limit = max(OFF_COURSE * 0.5 * sum(record.size for record in one.records), WORTH * base.fit.cost)
        found = _fitted(engine, one, catalogue, cost_limit)
        left = found.error_where_known / pooled(found.errors)[1]
        if left <= enough and not unlike_a_machine(found.fit.state.model):
            told = one.told if one.said is None else one.said(found.fit.state.model)
            one = replace(one, told=told, nearly=left > ADEQUATE)
            return _by_the_clock(one, found.fit.state.model, model), found
    return None


def shown_by_lines(one: Restated, base: Candidate, model: Model) -> bool:
    """Whether by another number of teeth all cuts turn as stated, though by the stated one their lines say otherwise."""
    if one.condition != "flutes" or model.cutter is None:
        return False
    off = [2.0 * math.pi / record.period / record.cut.spindle_speed for record in base.fitter.records if record.cut is not None]
    common = max(off) <= (1.0 + SLIPS) * min(off) and abs(off[0] - 1.0) > SLIPS
    return common and abs(one.factor / (off[0] * model.cutter.flutes) - 1.0) < SLIPS


def _some(records: Sequence[Observed]) -> list[int]:
    """Places of a few records from all over the campaign, cuts where there are any."""
    cuts = [place for place, record in enumerate(records) if record.cut is not None] or list(range(len(records)))
    return cuts[:: math.ceil(len(cuts) / GLANCED)]


def _fitted(engine: Engine, one: Restated, catalogue: Mapping[str, Effect], cost_limit: float) -> Candidate:
    """The model fitted to the records as they are stated otherwise."""
    if not one.more:
        return from_believed(engine, one.records, one.model, (), catalogue, cost_limit)
    free = [*identifiable_parameters(engine, one.records, one.model, catalogue, helps=False).free, *one.more]
    return candidate_of(*model_fit(engine, one.records, one.model, catalogue, free, cost_limit), (), None, 1.0)


def _by_the_clock(found: Restated, fitted: Model, believed: Model) -> Restated:
    """A speed or a sampling rate, whichever leaves the natural frequency nearer to what is believed: both fit as well."""
    if found.condition not in ("speed", "rate"):
        return found
    factor, other = 1.0 / found.factor, "rate" if found.condition == "speed" else "speed"
    rings = float(np.median([seen.natural_frequency / one.natural_frequency for seen, one
                             in zip(fitted.structure.modes, believed.structure.modes, strict=True)]))
    as_other = rings * factor if found.condition == "speed" else rings / found.factor
    first = _told_clock(found.condition, found.factor)
    second = _told_clock(other, factor)
    if abs(math.log(as_other)) < abs(math.log(rings)):
        return replace(found, condition=other, factor=factor, told=f"{second} (as well, {first[3:]})")
    return replace(found, told=f"{first} (as well, {second[3:]})")


def _told_clock(condition: str, factor: float) -> str:
    where = "" if condition == "rate" else " in all records"
    return f"if the {'sampling rate' if condition == 'rate' else 'spindle speed'} was {_times(factor)} the stated one{where}"


def instead_of(found: Diagnosis, restated: tuple[Restated, Candidate] | None) -> Diagnosis:
    """The diagnosis, or that a condition is written down wrongly, where this explains as much as the effects named."""
    if restated is None:
        return found
    statement, fitted = restated
    if isinstance(found.best, Candidate):
        size = effective_size(found.best.fit)
        allowed = DELTA_BIC if found.best.effects else -DELTA_BIC
        if bic(fitted.fit, size) > bic(found.best.fit, size) + allowed:
            return found
    return written_wrongly(found, statement)


def written_wrongly(found: Diagnosis, statement: Restated) -> Diagnosis:
    """The verdict that nothing is missing but a number written down right; no effect is named."""
    return replace(found, verdict="unexplained", effects=(), sentence=statement.sentence, best=found.base,
                   with_effects=found.baseline, steps=found.steps[:1], next_test=None, separates=(), form=None,
                   misstated=(statement.condition, statement.factor))  # fmt: skip
