"""The tap test: taps in, modes out, with what was left out, turned round and found out on the way."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from testbed.analysis.tap.averaged import Stretch, averaged
from testbed.analysis.tap.blows import Blow, find_blows, too_short
from testbed.analysis.tap.decays import UNKNOWN_MASS, decays_of
from testbed.analysis.tap.frequency_response import FEWEST_LINES, FrequencyResponse, axis_of
from testbed.analysis.tap.order import MOST_MODES, choose
from testbed.analysis.tap.poles import poles
from testbed.analysis.tap.real_modes import Fit, Lines, fit_modes, levels, residues, shapes_of
from testbed.analysis.tap.result import BlowSeen, FoundMode, Group, TapResult
from testbed.analysis.tap.scales import ScaleCheck, checked, repeated, said_of_scales
from testbed.analysis.tap.sensors import exchanged, sign_share, turned, unloaded
from testbed.analysis.tap.uncertain import estimates
from testbed.problem import InputProblem
from testbed.recording import Recording

_SEARCH_ERROR = 0.01  # of a response, that a model of real modes is taken to miss while modes are counted
_LEAST_ERROR = 1e-4  # likewise of the last fit, however well it goes
_EXCHANGED = 0.2  # of the misfit, that exchanged axes may leave at the most to be believed
_SETTLING = 10  # steps of a fit that is asked for its misfit alone
_EXPLAINS = 0.5  # of a response: modes that leave more explain nothing
_ALL_WITH = 0.9  # likewise, above which every mode answers with the force
_ALIKE = 0.02  # of a frequency, within which a decay shows what a struck response does
_LOW, _HIGH = 1.0, 1e6  # Hz: no band asked for


@dataclass
class _Noted:
    """What is collected on the way."""

    blows: list[BlowSeen] = field(default_factory=list)
    scales: list[ScaleCheck] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def tap_test(taps: Any, most_modes: int | None = None) -> TapResult:
    """Modes of the taps of a file (testbed.files.taps_file.Taps). Raises InputProblem where they hold none.

    most_modes: so many for each group of responses, instead of as many as the data ask for.
    """
    noted = _Noted()
    for tap in taps.taps:
        noted.notes += [f"{tap.name}: {note}" for note in tap.notes]
    free, struck = [tap for tap in taps.taps if tap.without_force], [tap for tap in taps.taps if not tap.without_force]
    decays, rung = decays_of(free, str(taps.file), noted.notes) if free else ([], [])
    if free:
        noted.notes.append(f"{', '.join(dict.fromkeys(tap.name for tap in free))}: no force was measured, so the blows tell "
                           "frequencies, damping ratios and shapes, but no mass")
    unweighed = [FoundMode(mode.natural_frequency, mode.damping_ratio, UNKNOWN_MASS, mode.direction, mode.on) for mode in rung]
    if not struck:
        residual = math.sqrt(float(np.mean([one.ring.residual**2 for one in decays])))
        return TapResult(tuple(unweighed), residual, (), (), tuple(dict.fromkeys(noted.notes)), tuple(decays))
    low, high = taps.band or (_LOW, _HIGH)
    masses: list[float] = []
    measured = _responses(taps, struck, masses, (low, high), noted)
    if taps.band is None:
        noted.notes += [f"{one.name}: rises towards 0 Hz like a sensor's drift. Nothing below {one.lowest:.4g} Hz is used; "
                        "to choose the frequencies yourself, give `band`" for one in measured if one.lowest > 0.0]
        measured = [one.from_lowest() for one in measured]
    responses = checked(_as_they_are(measured, (low, high), noted), (low, high), noted.scales)
    noted.notes += said_of_scales(noted.scales, [blow.force for blow in noted.blows if blow.used])
    responses = [unloaded(one, mass, noted.notes) for one, mass in zip(responses, masses, strict=True)]
    groups = [_group(part, low, high, most_modes, str(taps.file), noted) for part in _grouped(responses)]
    for group in groups:
        against = [f"{np.exp(row[0]) / (2.0 * np.pi):.5g} Hz"
                   for row, sign in zip(group.fit.parameters, group.fit.signs, strict=True) if sign < 0]
        if against:
            noted.notes.append(f"{group.responses[0].name}: moves against the force, no mass is told: {', '.join(against)}")
    told = all(check.agrees is not False for check in noted.scales)
    modes = sorted((mode for group in groups for mode in _modes(group, told)), key=lambda one: one.natural_frequency.value)
    free_alone = [one for one in unweighed if not any(_alike(one, mode) for mode in modes)]
    if free_alone:
        rung_at = ", ".join(f"{one.natural_frequency.value:.5g} Hz" for one in free_alone)
        noted.notes.append(f"rings without being struck at the measured force: {rung_at}")
    missed = sum(res**2 * _power(group, place) for group in groups for place, res in enumerate(group.residuals))
    whole = sum(_power(group, place) for group in groups for place in range(len(group.responses)))
    return TapResult(tuple(modes), math.sqrt(missed / whole), tuple(noted.blows), tuple(groups),
                     tuple(dict.fromkeys(noted.notes)), tuple(decays), tuple(noted.scales))


def _alike(one: FoundMode, other: FoundMode) -> bool:
    return one.on == other.on and abs(one.natural_frequency.value / other.natural_frequency.value - 1.0) < _ALIKE


def _power(group: Group, place: int) -> float:
    return float(np.sum(np.abs(group.fit.lines.measured[place]) ** 2))


def _responses(taps: Any, struck: Sequence[Any], masses: list[float], band: tuple[float, float],
               noted: _Noted) -> list[FrequencyResponse]:
    """Measured responses, records of one kind averaged together, and the mass of the sensor on each."""
    found: list[FrequencyResponse] = []
    records: dict[tuple, list[Any]] = {}
    for tap in struck:
        if tap.spectrum is not None:
            one = FrequencyResponse(tap.name, tap.spectrum.frequency, tap.spectrum.values, tap.along, tap.sensed, tap.on,
                                    decay=tap.window)
            found.append(one)
            masses.append(tap.sensor_mass)
        else:
            kind = (tap.along, tap.sensed, tap.on, tap.quantity, tap.record.sampling_rate, tap.window, tap.sensor_mass)
            records.setdefault(kind, []).append(tap)
    for (along, sensed, on, quantity, rate, window, mass), same in records.items():
        parts = [(tap.name, _stretches(tap, str(taps.file), noted)) for tap in same]
        own = [averaged(name, part, rate, quantity, along, sensed, on, window) for name, part in parts]
        factors = [1.0, *(repeated(one, own[0], band, noted.scales) for one in own[1:])]
        stretches = [replace(one, response=one.response * factor)
                     for (_, part), factor in zip(parts, factors, strict=True) for one in part]
        one = own[0] if len(own) == 1 else averaged(same[0].name, stretches, rate, quantity, along, sensed, on, window)
        if len(stretches) == 1:
            noted.notes.append(f"{same[0].name}: one blow gives no coherence. Its scatter over frequency gives the intervals")
        found.append(one)
        masses.append(mass)
    return found


def _stretches(tap: Any, place: str, noted: _Noted) -> list[Stretch]:
    """The blows of a record that are of use. Raises InputProblem where none is."""
    record: Recording = tap.record
    force, response = record.channels["force"], record.channels[tap.quantity]
    blows = find_blows(force, response, record.filled)
    if not blows:
        raise InputProblem(place, f"tap '{tap.name}' holds no blow: its force never rises above its noise",
                           "check the column of the force")
    if all(too_short(force, blow) for blow in blows):
        raise InputProblem(place, f"tap '{tap.name}' was sampled too slowly: a blow lasts less than three samples",
                           "sample faster, or use a softer tip")
    used = [blow for blow in blows if not blow.left_out]
    if not used:
        twice = [blow for blow in blows if blow.left_out == "it hit twice"]
        if not twice:
            raise InputProblem(place, f"tap '{tap.name}' has no blow of use: {blows[0].left_out}", "measure again")
        used = twice
        noted.notes.append(f"{tap.name}: every blow hit twice. All were used, without the lines that have no force")
    noted.blows += [BlowSeen(tap.name, record.start + blow.peak / record.sampling_rate, blow.force, blow in used,
                             "" if blow in used else blow.left_out) for blow in blows]
    return [_stretch(force, response, blow) for blow in used]


def _stretch(force: np.ndarray, response: np.ndarray, blow: Blow) -> Stretch:
    level = np.abs(force[blow.start : blow.peak] - np.median(force))
    quiet = np.flatnonzero(level > 0.02 * abs(blow.force))
    before = int(quiet[0]) if len(quiet) else blow.peak - blow.start
    return Stretch(force[blow.start : blow.stop], response[blow.start : blow.stop], max(0, before - 2))


def _as_they_are(responses: list[FrequencyResponse], band: tuple[float, float], noted: _Noted) -> list[FrequencyResponse]:
    """The responses with sensors turned and axes exchanged as they show themselves. Axes only with cross responses."""
    notes: list[str] = []
    given = turned(responses, band, notes)
    if all(one.drive_point for one in given):
        axes = {(one.on, axis_of(one.along)) for one in given}
        apart = [on for on in dict.fromkeys(one.on for one in given) if sum(on == other for other, _ in axes) > 1]
        notes += [f"no cross response joins x and y of the {on}: exchanged axes would not show, and modes lie along the axes "
                  "as stated" for on in apart]
        noted.notes += notes
        return given
    other_notes: list[str] = []
    other = turned(exchanged(responses), band, other_notes)
    if _misfit(checked(other, band, []), band) > _EXCHANGED * _misfit(checked(given, band, []), band):
        noted.notes += notes
        return given
    noted.notes += ["x and y of the sensors are exchanged: only then do the responses fit together. They were exchanged back",
                    *other_notes]
    return other


def _misfit(responses: list[FrequencyResponse], band: tuple[float, float]) -> float:
    """Weighted misfit of modes at all stable poles: how badly the directions that are stated fit together."""
    total = 0.0
    for group in _grouped(responses):
        kept = [(one, mask) for one in group if np.count_nonzero(mask := one.believed(*band)) >= FEWEST_LINES]
        if not kept:
            continue
        own, masks = [one for one, _ in kept], [mask for _, mask in kept]
        stable = poles(own, masks).stable[:MOST_MODES]
        lines = Lines(own, masks, _basis(own), _search_errors(own, masks))
        at = np.column_stack([2.0 * np.pi * stable[:, 0], stable[:, 1]])
        shapes, signs = shapes_of(lines, residues(lines, at[:, 0], at[:, 1])[0])
        total += fit_modes(lines, np.column_stack([np.log(at), shapes]), signs, _SETTLING).cost
    return total


def _grouped(responses: Sequence[FrequencyResponse]) -> list[list[FrequencyResponse]]:
    """Responses that must share their modes: of one carrier; x and y apart where nothing joins them."""
    groups = []
    for on in dict.fromkeys(one.on for one in responses):
        own = [one for one in responses if one.on == on]
        axes = {axis_of(vector) for one in own for vector in (one.along, one.sensed)}
        apart = all(one.drive_point for one in own) and axes <= {(1.0, 0.0), (0.0, 1.0)}
        groups += [[one for one in own if axis_of(one.along) == axis]
                   for axis in sorted(axes, reverse=True)] if apart else [own]
    return groups


def _basis(responses: Sequence[FrequencyResponse]) -> np.ndarray:
    vectors = {axis_of(vector) for one in responses for vector in (one.along, one.sensed)}
    return np.array([next(iter(vectors))]) if len(vectors) == 1 else np.eye(2)


def _group(responses: list[FrequencyResponse], low: float, high: float, most: int | None, place: str,
           noted: _Noted) -> Group:
    strong = [one for one in responses if np.count_nonzero(one.believed(low, high)) >= FEWEST_LINES]
    if strong:  # of responses that belong together, what shows nothing may be left out
        weak = [one for one in responses if all(one is not other for other in strong)]
        noted.notes += [f"{one.name}: left out, nothing in it stands above the noise" for one in weak]
        responses = strong
    masks = [one.believed(low, high) for one in responses]
    for one, mask in zip(responses, masks, strict=True):
        if np.count_nonzero(mask) < FEWEST_LINES:
            why = "force and response do not go together at enough frequencies" if one.coherence is not None else \
                "fewer lines than a mode needs stand above the noise"
            raise InputProblem(place, f"tap '{one.name}' holds no mode: {why}", "hit harder, more often, or check the columns")
    found = poles(responses, masks)
    basis = _basis(responses)
    against = len(basis) == 1 and any(one.drive_point and abs(sign_share(one, low, high)) < _ALL_WITH for one in responses)
    lines = Lines(responses, masks, basis, _search_errors(responses, masks), against)
    steps, chosen, wanted = choose(lines, found, most)
    if chosen > wanted > 0:
        noted.notes.append(f"{responses[0].name}: {chosen} modes were asked for, its data tell {wanted}: the others follow "
                           "noise, or what real modes do not explain")
    if chosen == 0:
        raise InputProblem(place, f"tap '{responses[0].name}' holds no mode: no pole of its response holds",
                           "check the columns and units, or widen `band`")
    fit = _weighed(lines, steps[chosen].fit)
    residuals = tuple(math.sqrt(float(np.sum(np.abs(one - other) ** 2) / np.sum(np.abs(other) ** 2)))
                      for one, other in zip(fit.fitted(), fit.lines.measured, strict=True))
    if min(residuals) > _EXPLAINS:
        left = f"{min(residuals):.0%} of it is left"
        raise InputProblem(place, f"tap '{responses[0].name}': no modes explain its response ({left})",
                           "check that force and response are of one blow, their columns and units")
    return Group(tuple(responses), found, tuple(steps), fit, residuals)


def _search_errors(responses: Sequence[FrequencyResponse], masks: Sequence[np.ndarray]) -> list[np.ndarray]:
    return [_SEARCH_ERROR * level for level in levels(responses, masks)]


def _weighed(lines: Lines, fit: Fit) -> Fit:
    """The last fit: lines weighed by their noise and by how far real modes miss them: by a share of each mode's part.

    A share of the measured response would make the lines where modes cancel, and where all their errors stand, the surest.
    """
    error = _SEARCH_ERROR
    for _ in range(3):
        size = fit.cost / max(1, lines.count - fit.parameters.size)
        again = min(1.0, max(_LEAST_ERROR, error * (math.sqrt(size) if size > 1.0 else size)))
        if abs(again - error) < 0.1 * error:
            break
        error = again
        lines = Lines(lines.responses, lines.masks, lines.basis, [error * size for size in fit.size_of_parts()], lines.against)
        fit = fit_modes(lines, fit.parameters, fit.signs)
    return fit


def _modes(group: Group, scaled: bool) -> list[FoundMode]:
    """The modes of a group; where one answers against the force, its mass is not determined. scaled: whether scales agree."""
    found = []
    for place, sign in enumerate(group.fit.signs):
        told = estimates(group.fit, place)
        if sign < 0 or not scaled:
            told["mass"] = replace(told["mass"], bounded=False)
        if not scaled:
            told["direction"] = replace(told["direction"], bounded=False)
        found.append(FoundMode(**told, on=group.responses[0].on))
    return found
