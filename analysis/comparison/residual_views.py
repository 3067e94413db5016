"""What is left of the records, looked at from several sides: against the tooth's angle, by frequency, on the chart."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from testbed.analysis.comparison.adequacy import tooth_angle
from testbed.analysis.comparison.amplitude import AmplitudeDependence
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.held_out import RecordError
from testbed.analysis.fit.observed import Observed
from testbed.analysis.linear.stability import StabilityChart, stability_chart
from testbed.analysis.records.lines import amplitude_spectrum
from testbed.machine import Model
from testbed.recording import CHANNEL_UNITS, quantity_of

SPEED_CELLS, DEPTH_CELLS = 401, 121  # of the chart; the lobes of period doubling are narrow in speed
COARSER = 2  # times, of a machine in x and y, whose cells take that much longer
SECTORS = 72  # of a tooth's turn
NEAR = 1.5  # lines of the spectrum's resolution that still belong to a line
NATURAL_BAND = 0.03  # of the natural frequency, to either side
MapUnits = tuple[tuple[float, str], tuple[float, str], tuple[float, str]]  # (factor, unit) of displacement, velocity, force
CALIBRATED: MapUnits = ((1e6, "µm"), (1e3, "mm/s"), (1.0, "N"))
_SHOWN = {"m": (1e6, "µm"), "m/s": (1e3, "mm/s"), "m/s^2": (1.0, "m/s²")}


def shown_unit(unit: str) -> tuple[float, str]:
    """(factor, name) of the unit in which a channel of an SI unit is drawn."""
    return _SHOWN.get(unit, (1.0, unit))


def drawn_unit(channel: str, units: Mapping[str, str]) -> tuple[float, str]:
    """(factor, name) of the unit in which a channel is drawn. units: SI or own; a channel not in it is calibrated."""
    return shown_unit(units.get(channel, CHANNEL_UNITS.get(quantity_of(channel), "")))


def drawn_units(decays: Sequence[AmplitudeDependence], units: Mapping[str, str]) -> tuple[list[float], list[str], str]:
    """How amplitudes are drawn: each decay's factor and label, which names its unit where they differ, and the axis's unit.

    units: SI or own, by channel; a channel not in it is taken to be calibrated.
    """
    drawn = [shown_unit(units.get(one.channel, one.unit)) for one in decays]
    different = list(dict.fromkeys(unit for _, unit in drawn))
    labels = [one.name if len(different) == 1 else f"{one.name} [{unit}]" for one, (_, unit) in zip(decays, drawn, strict=True)]
    return [factor for factor, _ in drawn], labels, ", ".join(different)


def map_units(units: Mapping[str, str]) -> MapUnits:
    """In what to draw a force-state map of channels in `units`: where one is uncalibrated, so is the force."""
    usual = {name: CHANNEL_UNITS.get(name.split("_")[0]) for name in units if not name.startswith("tachometer")}
    if all(unit in (None, units[name]) for name, unit in usual.items()):
        return CALIBRATED
    own = units.get("displacement", "")
    if own == CHANNEL_UNITS["displacement"]:
        return *CALIBRATED[:2], (1.0, "uncalibrated")
    unknown = (1.0, "uncalibrated")
    return ((1.0, own), (1.0, f"{own}/s"), unknown) if own else (unknown, unknown, unknown)


def map_holds(name: str) -> str:
    """What the force of a force-state map holds, by the map's name (analysis/force/force_state.py)."""
    if "while a tooth cuts" in name:
        return "it holds the error of the chip force, too"
    return "no tooth cuts there: a force of the motion alone" if "out of the cut" in name else ""


@dataclass(frozen=True)
class AngleView:
    """Mean residual by the angle since a tooth's entry, over one turn of the spindle, while cutting.

    angle (deg, sectors,), mean in units of the noise (sectors,), error: what chance alone leaves of a mean; engaged:
    degrees of each pitch in which a tooth cuts.
    """

    name: str
    channel: str
    angle: np.ndarray
    mean: np.ndarray
    error: np.ndarray
    pitch: float
    engaged: float

    @property
    def peak(self) -> tuple[float, float]:
        """(angle in deg, mean residual over noise) where the mean is furthest from its own middle."""
        place = int(np.nanargmax(np.abs(self.mean - np.nanmean(self.mean))))
        return float(self.angle[place]), float(self.mean[place])


def by_angle(record: Observed, error: RecordError, state: State, index: int) -> list[AngleView]:
    """A view for each channel of a cut; empty for other records, and where it never cuts."""
    if record.cut is None:
        return []
    turn = tooth_angle(replace(record, flutes=1), state.angle, state.nuisances[index])
    time = record.start + np.arange(record.samples) / record.rate
    cutting = np.zeros(record.samples, dtype=bool)
    for segment in record.segments:
        if segment.kind in ("entry", "steady", "exit"):
            cutting |= (time >= segment.start) & (time < segment.stop)
    sectors = max(8, min(SECTORS * record.flutes, int(0.5 * record.period * record.rate)))  # no sector without samples
    place = (turn[cutting] / (2 * math.pi) * sectors).astype(int) % sectors
    count = np.bincount(place, minlength=sectors)
    if not cutting.any():
        return []
    engaged = math.degrees(state.model.cutting.engagement_angle) if state.model.cutting else 0.0
    views = []
    for channel, rest, noise in zip(record.channels, error.residual, record.noise, strict=True):
        part = rest[cutting] / noise
        mean = np.where(count > 0, np.bincount(place, part, minlength=sectors) / np.maximum(count, 1), np.nan)
        views.append(
            AngleView(
                record.name,
                channel,
                (np.arange(sectors) + 0.5) * 360.0 / sectors,
                mean,
                float(part.std()) / np.sqrt(np.maximum(count, 1)),
                360.0 / record.flutes,
                engaged,
            )
        )
    return views


@dataclass(frozen=True)
class SpectrumView:
    """Amplitude spectrum of one channel's residual, the lines it could have, and what share of its power is at each.

    frequency (Hz) up to a few natural frequencies, amplitude of the residual and of what was measured (channel's unit);
    tooth, spindle: Hz, 0 where there is none; natural: of the modes that the channel's sensor may see, Hz. shares: of the
    residual's power at tooth-passing harmonics, other turns of the spindle, about those, and elsewhere; ratio: rms of the
    residual over the noise.
    """

    name: str
    channel: str
    frequency: np.ndarray
    amplitude: np.ndarray
    measured: np.ndarray
    tooth: float
    spindle: float
    natural: tuple[float, ...]
    shares: Mapping[str, float]
    ratio: float


def by_frequency(record: Observed, error: RecordError, state: State, index: int, reach: float = 10.0) -> list[SpectrumView]:
    """A view for each channel, up to `reach` natural frequencies or ten tooth passages, whichever is more."""
    slowest, fastest = state.model.structure.frequency_range
    spindle = state.nuisances[index].speed / record.period if record.cut is not None else 0.0
    tooth = spindle * record.flutes
    top = min(record.rate / 2, max(reach * slowest, 2.0 * fastest, 10.0 * tooth))
    views = []
    rows = zip(record.channels, record.sensors, record.data, error.residual, record.noise, strict=True)
    for channel, sensor, data, rest, noise in rows:
        frequency, amplitude = _spectrum(record, rest)
        power, width = amplitude**2, NEAR * record.rate / record.samples
        modes = state.model.structure.modes
        own = tuple(mode.natural_frequency for mode in modes if sensor is not None and mode.on == sensor.on)
        is_tooth = _on(frequency, tooth, width)
        is_spindle = _on(frequency, spindle, width) & ~is_tooth
        is_natural = np.zeros(len(frequency), dtype=bool)
        for one in own:
            is_natural |= (np.abs(frequency - one) < max(NATURAL_BAND * one, width)) & ~is_tooth & ~is_spindle
        total = max(float(power.sum()), 1e-300)
        shares = {
            "tooth passing": float(power[is_tooth].sum()) / total,
            "spindle, not tooth": float(power[is_spindle].sum()) / total,
            "natural frequency": float(power[is_natural].sum()) / total,
        }
        shares["elsewhere"] = max(1.0 - sum(shares.values()), 0.0)
        kept = frequency <= top
        views.append(
            SpectrumView(
                record.name,
                channel,
                frequency[kept],
                amplitude[kept],
                _spectrum(record, data)[1][kept],
                tooth,
                spindle if record.flutes > 1 or record.cut is not None else 0.0,
                own,
                shares,
                float(np.sqrt(np.mean(rest**2))) / float(noise),
            )
        )
    return views


def _spectrum(record: Observed, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies (Hz) and amplitudes: of a cut through a window; of a blow or a decay, which begins loud, without one."""
    if record.cut is not None:
        return amplitude_spectrum(values, record.rate)
    flat = values - values.mean()
    return np.fft.rfftfreq(len(values), 1 / record.rate), np.abs(np.fft.rfft(flat)) * 2 / len(values)


def _on(frequency: np.ndarray, base: float, width: float) -> np.ndarray:
    """Whether frequencies lie on the comb of a base frequency (Hz); nowhere where the comb is as fine as the width."""
    if base <= 4.0 * width:
        return np.zeros(len(frequency), dtype=bool)
    order = np.round(frequency / base)
    return (np.abs(frequency - order * base) < width) & (order > 0)


@dataclass(frozen=True)
class ChartView:
    """The stability chart of the fitted machine with each cut's place and its error over noise floor."""

    chart: StabilityChart
    names: tuple[str, ...]
    speeds: np.ndarray
    depths: np.ndarray
    ratios: np.ndarray


def on_chart(records: Sequence[Observed], errors: Sequence[RecordError], model: Model) -> ChartView | None:
    """Misfit over speed and depth; None where nothing is cut."""
    cuts = [(record, error) for record, error in zip(records, errors, strict=True) if record.cut is not None]
    if not cuts or model.cutting is None:
        return None
    speeds = np.array([record.cut.spindle_speed for record, _ in cuts])  # type: ignore[union-attr]
    depths = np.array([record.cut.axial_depth_of_cut for record, _ in cuts])  # type: ignore[union-attr]
    deepest = 1.5 * float(depths.max())
    coarser = COARSER if model.planar else 1
    across, up = SPEED_CELLS // coarser, DEPTH_CELLS // coarser
    chart = stability_chart(
        model,
        np.linspace(0.85 * speeds.min(), 1.15 * speeds.max(), across),
        np.linspace(deepest / up, deepest, up),
    )
    ratios = np.array([error.error / max(error.noise_floor, 1e-300) for _, error in cuts])
    return ChartView(chart, tuple(record.name for record, _ in cuts), speeds, depths, ratios)
