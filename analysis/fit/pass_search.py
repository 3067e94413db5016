"""Whole numbers and angles of single records looked for at fixed machine parameters: passes of entry and exit, phases."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.first_state import begun_as_seen
from testbed.analysis.fit.fit_state import State, WaveformFit, together
from testbed.analysis.fit.nuisances import Nuisances, other_teeth, turned_by
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.waveform import Fitter
from testbed.machine import Model
from testbed.system.threads import threaded

COARSE = 24  # places over a record at which an exit is looked for first
EARLIER = 5  # passes by which a gentle entry may precede what is seen of it
TURNS = (0.0, -0.4, -0.25, -0.15, -0.07, 0.07, 0.15, 0.25, 0.4)  # rad: where the angle of a record without marks is tried;
# and a swing of the structure to either side, where a kick comes to much the same
SHORTEST = 0.25  # share of a cut that is seen which it lasts at the least, however wrong the model
DIED_AWAY = 5.0  # logarithm by which a vibration has fallen when nothing is seen of it any more
UNDAMPED = 1e-6  # damping ratio below which no vibration dies away within any record
RECENT = 20.0  # in minus the log likelihood, by which a cut that began shortly before its record is the better
SMALL = 0.1  # of a record's motion, by which the swing at its entry is changed to see what comes of it
ROUND = 8  # places round the circle at which a record's own phase is looked for


def settle_passes(fitter: Fitter, state: State, reach: int = 1, places: Sequence[int] | None = None) -> tuple[State, bool]:
    """The state with every cut's entry and exit pass at the best of their neighbours; and whether any moved.

    places: of the records that are asked; None: all.
    Without a tachometer the record's tooth angle is looked for around where it was, too, and which tooth came first, as where
    its marks may be any of several.
    """

    def one(index: int) -> Nuisances:
        record, nuisances = fitter.records[index], state.nuisances[index]
        nuisances = _turned(fitter, index, state)
        if record.cut is None:
            return nuisances
        if record.first_mark is None:
            swings = [2 * math.pi / (record.period * mode.natural_frequency) for mode in state.model.structure.modes]
            beside = [sign * swing for swing in swings for sign in (-1.0, 1.0)]
            turns = [replace(nuisances, angle=nuisances.angle + turn) for turn in (*TURNS, *beside)]
            nuisances = _best(fitter, index, state, [*turns, *other_teeth(nuisances, record.flutes)])
        elif record.slots > 1:
            others = other_teeth(nuisances, record.flutes, record.flutes // record.slots)
            nuisances = _best(fitter, index, state, [nuisances, *others])
        last = record.last_pass(state.angle, nuisances)
        entries = list(range(nuisances.entry - EARLIER, nuisances.entry + reach + 1))
        if record.starts_in_cut:
            since = record.first_simulated
            entries = [] if nuisances.entry <= since else [since, *(one for one in entries if one > since)]
        exits = range(0) if nuisances.exit > last else range(nuisances.exit - reach, nuisances.exit + reach + 1)
        nuisances = _best_place(fitter, index, state, nuisances, "entry", entries)
        return _best_place(fitter, index, state, nuisances, "exit", exits)

    places = _asked(fitter, places)
    found = state.with_records(places, threaded(one, places))
    return found, found.nuisances != state.nuisances


def begun_otherwise(fitter: Fitter, state: State) -> tuple[State, bool]:
    """The state with every cut begun at rest, or as its first samples show, where that explains it better; and whether any is.

    A vibration that a model without friction needed at the start of a record leads, with friction, to where no slope shows
    the way back.
    """

    def one(index: int) -> Nuisances:
        nuisances = state.nuisances[index]
        record = fitter.records[index]
        if record.cut is None or record.starts_in_cut:
            return nuisances
        still = replace(nuisances, displacement=0.0, velocity=0.0, states=())
        return _best(fitter, index, state, [nuisances, still, begun_as_seen(record, still, state.model.structure)])

    best = threaded(one, range(len(fitter.records)))
    return replace(state, nuisances=best), best != state.nuisances


def turn_phases(fitter: Fitter, state: State, places: Sequence[int]) -> State:
    """The state with the phases that the records at these places have for themselves at the best of angles all round."""
    return state.with_records(places, threaded(lambda index: _turned(fitter, index, state), places))


def _turned(fitter: Fitter, index: int, state: State) -> Nuisances:
    nuisances = state.nuisances[index]
    for free in fitter.shifting:
        turns = [turned_by(nuisances, free.path, 2 * math.pi * part / ROUND) for part in range(ROUND)]
        nuisances = _best(fitter, index, state, turns)
    return nuisances


def place_entries(fitter: Fitter, state: State, places: Sequence[int] | None = None) -> State:
    """The state with every cut's entry looked for from the record's start to the exit, coarse first.

    places: of the records that are asked; None: all. A record that seems to start in the cut may idle amid loud ambient
    vibration: of forces alone that cannot be.
    """
    return _placed(fitter, state, "entry", _asked(fitter, places))


def recently_entered(fitter: Fitter, state: State) -> State:
    """The state with cuts that began shortly before their record, so that it starts in the transient, begun there.

    Of those that the records start in; any pass of as long as a vibration takes to die away is tried.
    """

    def one(index: int) -> Nuisances:
        own = state.nuisances[index]
        tried = _recent_entries(fitter.records[index], own, state.model)
        if not tried:
            return own
        squares = squares_of(fitter, index, state, [own, *tried])
        best = int(np.argmin(squares))
        return [own, *tried][best] if squares[best] < squares[0] - 2.0 * RECENT else own

    return replace(state, nuisances=threaded(one, range(len(fitter.records))))


def swung_entry(single: Fitter, state: State) -> State:
    """The state of one record that starts in its cut, begun shortly before, where the structure still swung as it entered.

    At the pass, and with the swing, that explain the record best; as it was where it cannot be so.
    """
    own = state.nuisances[0]
    tried = [_swung(single, state, each) for each in _recent_entries(single.records[0], own, state.model)]
    return state.with_record(0, _best(single, 0, state, tried)) if tried else state


def _recent_entries(record: Observed, own: Nuisances, model: Model) -> list[Nuisances]:
    """The nuisances of a record that starts in its cut with every entry of which a vibration may not have died away."""
    if record.cut is None or not record.starts_in_cut or record.forces_only:
        return []
    memory = DIED_AWAY / min(max(one.damping_ratio, UNDAMPED) * one.natural_frequency_rad for one in model.structure.modes)
    since = max(record.first_simulated + 1, record.first_pass - math.ceil(memory / record.period * record.flutes))
    return _tried(own, "entry", range(since, record.first_pass + 2 * record.flutes + 1))


def _swung(single: Fitter, state: State, own: Nuisances) -> Nuisances:
    """The nuisances of one record with the state at its simulation's beginning that explains it best, to first order."""
    size, paths = SMALL * single.records[0].motion_size, [path for pair in single.records[0].further_states for path in pair]
    unit = np.array([step for mode in state.model.structure.modes for step in (size, size * mode.natural_frequency_rad)])
    still = replace(own, displacement=0.0, velocity=0.0, states=())

    def begun(first: np.ndarray) -> Nuisances:
        further = tuple(zip(paths, map(float, first[2:]), strict=True))
        return replace(still, displacement=float(first[0]), velocity=float(first[1]), states=further)

    tried = [still, *map(begun, np.diag(unit))]
    rest = single.residuals_of(0, [(state.model, state.angle, one) for one in tried])
    return begun(unit * np.linalg.lstsq((rest[1:] - rest[0]).T, -rest[0], rcond=None)[0])


def entered(records: Sequence[Observed], state: State) -> list[Observed]:
    """The records, of which those that idle after all, amid so much vibration that they seemed to cut from the start, do so."""
    found = []
    for record, own in zip(records, state.nuisances, strict=True):
        idles = record.cut is not None and record.pass_start(own.entry, state.angle, own) > record.start + record.period
        found.append(replace(record, starts_in_cut=False) if idles and record.starts_in_cut else record)
    return found


def place_exits(fitter: Fitter, state: State) -> State:
    """The state with every cut's exit looked for from the entry to the record's end, coarse first.

    No segment is believed. The cost falls towards the true exit from both sides: too early, the model rings down while
    the teeth still cut; too late, it cuts where the structure rings down.
    """
    return _placed(fitter, state, "exit", _asked(fitter))


def _asked(fitter: Fitter, places: Sequence[int] | None = None) -> Sequence[int]:
    return range(len(fitter.records)) if places is None else places


def _placed(fitter: Fitter, state: State, field: str, places: Sequence[int]) -> State:
    def one(index: int) -> Nuisances:
        record, nuisances = fitter.records[index], state.nuisances[index]
        if record.cut is None or (field == "entry" and record.starts_in_cut and record.forces_only):
            return nuisances
        first, last = _range(record, state.angle, nuisances, field)
        if last <= first:
            return nuisances
        now = getattr(nuisances, field)
        step = max(1, (last - first) // COARSE)
        coarse = _tried(nuisances, field, {*range(first, last + 1, step), now, last})
        costs = squares_of(fitter, index, state, coarse)
        best = int(np.argmin(costs))
        reach = max(step, 2 * EARLIER)  # close to it a few kicks may cancel: no descent, every pass is tried
        found = getattr(coarse[best], field)
        near = {*range(max(first, found - reach), min(last, found + reach) + 1)}
        finer = _tried(nuisances, field, near - {getattr(one, field) for one in coarse})
        beside = squares_of(fitter, index, state, finer) if finer else np.array([np.inf])
        return finer[int(np.argmin(beside))] if beside.min() < costs[best] else coarse[best]

    return state.with_records(places, threaded(one, places))


def _range(record: Observed, angle: float, nuisances: Nuisances, field: str) -> tuple[int, int]:
    """First and last pass between which an entry or exit is looked for.

    Under a model that is wrong for a loud record it explains most of it that hardly a tooth cuts, and no fit comes back from
    there: so a cut that is seen to begin does so not much later, and lasts for a part of what is seen.
    """
    seen = first_nuisances(record, angle + nuisances.angle)
    part = 0 if record.starts_in_cut else max(0, round(SHORTEST * (seen.exit - seen.entry)))
    if field == "exit":
        return nuisances.entry + max(1, part), record.last_pass(angle, nuisances) + 1
    last = nuisances.exit - 1
    return record.first_pass, min(last, max(seen.entry + part, record.first_pass)) if part else last


def _best_place(fitter: Fitter, index: int, state: State, nuisances: Nuisances, field: str, places: Iterable[int]) -> Nuisances:
    """The nuisances of one record with `field` (entry or exit) at the place of the smallest residual."""
    tried = _tried(nuisances, field, places)
    return _best(fitter, index, state, tried) if tried else nuisances


def _tried(nuisances: Nuisances, field: str, places: Iterable[int]) -> list[Nuisances]:
    """The nuisances with `field` (entry or exit) at each of the places, in their order, that leave a cut."""
    moved = (nuisances.with_fields(**{field: place}) for place in sorted(places))
    return [one for one in moved if one.entry < one.exit]


def _best(fitter: Fitter, index: int, state: State, tried: Sequence[Nuisances]) -> Nuisances:
    """Those nuisances of one record that leave the smallest residual."""
    return tried[int(np.argmin(squares_of(fitter, index, state, tried)))]


def squares_of(fitter: Fitter, index: int, state: State, tried: Sequence[Nuisances]) -> np.ndarray:
    """Sums of squared residuals (tried,) of one record with each of these nuisances, what its marks say among them.

    So many at a time: how many are tried grows with the length of a record, and so would its square be the memory.
    """
    variants = [(state.model, state.angle, one) for one in tried]
    most, found = together(fitter.records[index].size) - 1, np.empty(len(tried))
    for begin in range(0, len(tried), most):
        lead = variants[: min(begin, 1)]  # the first is beside all: what steps it needs, the others take
        rest = fitter.residuals_of(index, [*lead, *variants[begin : begin + most]])[len(lead) :]
        found[begin : begin + most] = np.einsum("ij,ij->i", rest, rest)
    return found


def left_at(fitter: Fitter, fit: WaveformFit, index: int, tried: Sequence[Nuisances]) -> np.ndarray:
    """Residuals (tried, values) of one record with each of these nuisances, less what its own unknowns then make up for.

    To first order about the fit.
    """
    state = fit.state
    return fit.parts[index].without_own(fitter.residuals_of(index, [(state.model, state.angle, one) for one in tried]))
