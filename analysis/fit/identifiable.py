"""What the channels of a campaign tell of a machine in the plane: asked at the believed model, before any fit.

Motion alone tells forces only relative to the masses that they move; one direction may not tell two coefficients apart; a mode
that no sensor sees is told by nothing. No table lists such cases: the slopes of all records by all parameters, with what
belongs to the records eliminated, show how far each parameter could move unseen. One that could move further than a belief is
off is held where it is believed, and what then becomes sharper was entangled with it (Belsley, Kuh and Welsch 1980, Regression
Diagnostics, chapter 3). The same slopes of channels that were not measured say what would tell it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import is_

import numpy as np

from testbed.analysis.fit.effect_start import all_free
from testbed.analysis.fit.estimates import unit_of
from testbed.analysis.fit.fit_state import FreeParameter, State, WaveformFit
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.held_out import own_refit
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import Engine, predict
from testbed.analysis.fit.starts import scan_starts
from testbed.analysis.fit.structure_start import structure_start
from testbed.analysis.fit.waveform import Fitter
from testbed.effect import Effect
from testbed.machine import CARRIERS, Model, base_parameter
from testbed.recording import channel_in_words, motion_channel
from testbed.units import format_quantity

# natural steps of a parameter by which a belief may be off: frequency 2 %, damping ratio 20 %, mass 20 %, direction 10 deg,
# coefficients 30 %; of one that is to be held, the first of these whose value the records do not tell
DOUBT = {"mass": 4.0, "normal_coefficient": 1.5, "direction": 1.75, "damping_ratio": 1.0, "natural_frequency": 2.0,
         "tangential_coefficient": 1.5}
OF_EFFECTS = 10.0  # the same of an effect's parameter, of which little is believed
SLIGHT = 1e-3  # information that stands in for a belief, so that what is not told has a finite error
SHARPER = 2.0  # times, by which a parameter's error falls that was entangled with one that is held
NOISE_OF_FORCE = 0.01  # of a force's rms, taken for the noise of a dynamometer that was not there
ASKED = 2  # records by which it is asked what another sensor would tell
AS_WELL = 2.0  # in minus the log likelihood, up to which another fit explains as much: two standard errors
MOST_HELP = 2  # sensors that are named
LOUD = 3.0  # times as much motion as was measured, from which a cut of the believed machine grows as the true one's did not
LOWER, LOWERINGS = 0.7, 8  # factor by which its coefficients are then taken lower, and how often at the most


@dataclass(frozen=True)
class Untold:
    """A parameter held as believed: what it is entangled with, and which measurements would tell it."""

    path: str
    value: float
    unit: str
    entangled: tuple[str, ...] = ()
    helps: tuple[str, ...] = ()

    def said(self, channels: Sequence[str]) -> str:
        """In words, for records of these channels."""
        usual = {"N/m^2": "N/mm^2", "rad": "deg"}.get(self.unit, self.unit)
        held = f"{format_quantity(self.value, usual, 4)}, as the model has it"
        only = f"{' and '.join(map(channel_in_words, channels))} alone" if len(channels) < 3 else "these channels"
        if self.entangled:
            first = f"{only} cannot tell {self.path} from {', '.join(self.entangled)}: {self.path} is held at {held}"
            first += ", and were it 1 % more, the others would follow" if self.path.endswith("mass") else ""
        else:
            first = f"{only} cannot tell {self.path}: it is held at {held}"
        return first + (f"; to tell it, measure {', or '.join(self.helps)}" if self.helps else "")


@dataclass(frozen=True)
class Identifiable:
    """What is unknown in a fit of these records, and what is held as believed."""

    free: tuple[FreeParameter, ...]
    held: tuple[Untold, ...] = ()
    channels: tuple[str, ...] = ()
    records: tuple[Observed, ...] = field(default=(), repr=False, compare=False)

    @property
    def notes(self) -> list[str]:
        """In words, a line for each parameter that is held."""
        return [one.said(self.channels) for one in self.held]

    def asked_of(self, records: Sequence[Observed]) -> bool:
        """Whether it is of these very records."""
        return len(records) == len(self.records) and all(map(is_, records, self.records))


def identifiable_parameters(engine: Engine, records: Sequence[Observed], model: Model, catalogue: Mapping[str, Effect],
                            helps: bool = True) -> Identifiable:  # fmt: skip
    """The parameters that a fit of these records may leave free; of one mode along the feed all that are known to be told.

    helps: whether it is asked, too, which other sensors would tell what is held.
    """
    every = all_free(records, model, catalogue)
    free = [one for one in every if not one.each_record]  # what a record has for itself is eliminated with its other unknowns
    channels = tuple(dict.fromkeys(channel for record in records for channel in record.channels))
    if not model.structure.planar:
        return Identifiable(tuple(every), (), channels, tuple(records))
    state = _no_louder(engine, records, scan_starts(engine, records, structure_start(records, model), 1, (1.0,))[0])
    decays = [place for place, record in enumerate(records) if record.kind == "ring-down"]  # at rest they would tell nothing
    state = own_refit(Fitter(engine, records, free), state, decays)
    doubt = np.array([DOUBT.get(base_parameter(one.path) or "", OF_EFFECTS) for one in free])
    known = _information(engine, records, state, free)
    order = _held(known, doubt, free)
    if not order:
        return Identifiable(tuple(every), (), channels, tuple(records))
    more = _of_other_sensors(engine, records, state, free) if helps else {}
    held = []
    for count, place in enumerate(order):
        others = [one for one in range(len(free)) if one not in order[:count]]
        before = dict(zip(others, _errors(known, doubt, others), strict=True))
        rest = [one for one in others if one != place]
        after = dict(zip(rest, _errors(known, doubt, rest), strict=True))
        entangled = tuple(free[one].path for one in rest if before[one] > SHARPER * after[one] and one not in order)
        helping = [name for name, added in more.items() if _errors(known + added, doubt, others)[others.index(place)] < 1.0]
        path = free[place].path
        held.append(Untold(path, model.value(path), unit_of(path, catalogue), entangled, tuple(helping[:MOST_HELP])))
    kept = {one.path for one in held}
    return Identifiable(tuple(one for one in every if one.path not in kept), tuple(held), channels, tuple(records))


def _no_louder(engine: Engine, records: Sequence[Observed], state: State) -> State:
    """The state, its coefficients lowered together until no cut is much louder than it was measured.

    A belief a little too high may chatter where the machine did not: slopes of what grows without end seem to tell anything.
    """
    def loud(index: int) -> bool:
        record = records[index]
        seen = predict(engine, record, [(state.model, state.angle, state.nuisances[index])])[0]
        return not np.linalg.norm(record.project(seen)) <= LOUD * np.linalg.norm(record.project(record.data))

    cuts = [place for place, record in enumerate(records) if record.cut is not None]
    for _ in range(LOWERINGS):
        if state.model.cutting is None or not any(map(loud, cuts)):
            break
        lower = {path: LOWER * state.model.value(path) for path in ("tangential_coefficient", "normal_coefficient")}
        state = replace(state, model=state.model.with_values(lower))
    return state


def with_strayed_modes(fitter: Fitter, fit: WaveformFit, believed: Model) -> tuple[Fitter, WaveformFit]:
    """The fit with every mode whose frequency strayed from its belief by more than that may be off begun there again.

    A mode that hardly moves may end in any valley. The cheapest of the fits is kept, with those that explain as much beside it.
    """
    if not believed.structure.planar:
        return fitter, fit
    steps, tried = {one.path: one.scale for one in fitter.free}, [fit]
    for place in range(len(believed.structure.modes)):
        paths = [path for path in steps if path.startswith(f"modes[{place}].") and base_parameter(path) != "mass"]
        rung = believed.mode_path(place, "natural_frequency")
        strayed = abs(fit.state.model.value(rung) - believed.value(rung)) / steps[rung] if rung in steps else 0.0
        if strayed > DOUBT["natural_frequency"]:
            values = {path: believed.value(path) for path in paths}
            tried.append(fitter.fit(replace(fit.state, model=fit.state.model.with_values(values))))
    best = min(tried, key=lambda one: one.cost)
    near = best.cost + AS_WELL * max(1.0, best.variance)
    return fitter, replace(best, alike=(*fit.alike, *(one.state for one in tried if one is not best and one.cost <= near)))


def spread_by_held(fitter: Fitter, fit: WaveformFit, believed: Model) -> dict[str, float]:
    """By how much (standard deviation, SI) each free parameter follows what is held, if that is as far off as a belief may be.

    Masses are not asked: all that motion tells of forces is relative to one, which is said.
    """
    known = {one.path for one in fitter.free}
    held = [one for one in free_parameters(fitter.records, believed)
            if one.path not in known and base_parameter(one.path) != "mass"]
    if not believed.structure.planar or not held:
        return {}
    count = len(fitter.free)
    information = _information(fitter.engine, fitter.records, fit.state, [*fitter.free, *held])
    places = np.arange(count, count + len(held))
    rest = np.setdiff1d(np.arange(len(information)), places)
    doubt = np.array([DOUBT[base_parameter(one.path) or ""] for one in held])
    follows = np.linalg.lstsq(information[np.ix_(rest, rest)], information[np.ix_(rest, places)] * doubt, rcond=1e-12)[0]
    moved = np.sqrt(np.sum(follows**2, axis=1))
    return {one.path: float(size) * one.scale for one, size in zip(fitter.free, moved, strict=False)}


def _held(known: np.ndarray, doubt: np.ndarray, free: Sequence[FreeParameter]) -> list[int]:
    """Places of the parameters to hold, one after the other, until the records tell all others better than a belief does."""
    names = list(DOUBT)
    found: list[int] = []
    turns = {place: names.index(name) for place, one in enumerate(free) if (name := base_parameter(one.path)) in DOUBT}
    while True:
        others = [place for place in range(len(free)) if place not in found]
        errors = dict(zip(others, _errors(known, doubt, others), strict=True))
        untold = [place for place in others if errors[place] > 1.0 and place in turns]
        if not untold:
            return found
        found.append(min(untold, key=lambda place: (turns[place], place)))


def _errors(known: np.ndarray, doubt: np.ndarray, places: Sequence[int]) -> np.ndarray:
    """Standard errors of the parameters at these places, all others held, over what their beliefs may be off by."""
    rest = list(range(len(doubt), len(known)))  # the mark's angle, of which nothing is believed
    wide = np.concatenate([doubt[list(places)], np.ones(len(rest))])
    chosen = [*places, *rest]
    scaled = known[np.ix_(chosen, chosen)] * np.outer(wide, wide)
    size = np.sqrt(np.maximum(np.diag(scaled), 0.0) + SLIGHT)
    inverse = np.linalg.inv((scaled + SLIGHT * np.eye(len(chosen))) / np.outer(size, size))
    return np.sqrt(np.maximum(np.diag(inverse)[: len(places)], 0.0)) / size[: len(places)]


def _information(engine: Engine, records: Sequence[Observed], state: State, free: Sequence[FreeParameter]) -> np.ndarray:
    """Fisher information of the shared unknowns, in their natural steps, with each record's own unknowns eliminated.

    By central differences: where forces and masses grow alike nothing changes, but slopes to one side would show their bend.
    """
    fitter = Fitter(engine, records, free)
    back = Fitter(engine, records, [replace(one, scale=-one.scale) for one in free])
    count, whole = len(fitter.free), np.zeros((len(fitter.names), len(fitter.names)))
    for part, other in zip(fitter.linearise_all(state), back.linearise_all(state), strict=True):
        slopes = part.shared.copy()
        slopes[:, :count] = 0.5 * (slopes[:, :count] - other.shared[:, :count])
        slopes = part.without_own(slopes.T)
        whole += slopes @ slopes.T
    return whole


def _of_other_sensors(engine: Engine, records: Sequence[Observed], state: State, free: Sequence[FreeParameter]
                      ) -> dict[str, np.ndarray]:  # fmt: skip
    """The information that sensors would add which were not there, by their names in words."""
    measured = {channel for record in records for channel in record.channels}
    carriers = [on for on in CARRIERS if any(mode.on == on for mode in state.model.structure.modes)]
    options = {f"the motion of the {on} along {axis}": (motion_channel(f"displacement_{axis}", on),)
               for on in carriers for axis in "xy"} | {"the cutting force": ("force_x", "force_y")}
    cuts = [place for place, record in enumerate(records) if record.cut is not None]
    found = {}
    for name, channels in options.items():
        asked = (cuts or ([] if channels[0].startswith("force") else range(len(records))))[:ASKED]
        if asked and not measured & set(channels):
            one = state.of_records(asked)
            seen = [_sensed(engine, records[place], one, index, channels) for index, place in enumerate(asked)]
            found[name] = _information(engine, seen, one, free) * len(cuts or records) / len(asked)
    return found


def _sensed(engine: Engine, record: Observed, state: State, index: int, channels: tuple[str, ...]) -> Observed:
    """A record as other sensors would have seen it, by the state: displacements as noisy as its own motion."""
    count = len(channels)
    bare = replace(record, channels=channels, data=np.zeros((count, record.samples)), noise=np.ones(count), weight=None)
    values = np.nan_to_num(predict(engine, bare, [(state.model, state.angle, state.nuisances[index])])[0])
    noise = NOISE_OF_FORCE * values.std(axis=1)
    if not channels[0].startswith("force"):
        place, order, omega = record.motion or (0, 0, 1.0)
        own = record.noise[place] / omega**order if record.motion else NOISE_OF_FORCE * record.motion_size
        noise = np.full(count, own)
    return replace(bare, data=values, noise=np.maximum(noise, 1e-300))
