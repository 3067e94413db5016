"""Pictures of where a model fails, one question each: which record, when, at which tooth angle and frequency, at which
speed and depth; whether the machine's constants are constant, and whether its free decays depend on amplitude.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from testbed.analysis.comparison.amplitude import AmplitudeDependence, free_decays
from testbed.analysis.comparison.compare import Comparison
from testbed.analysis.comparison.constancy import COVARIATES, Constancy
from testbed.analysis.comparison.orbit import Orbit, orbits
from testbed.analysis.comparison.residual_views import (
    CALIBRATED,
    MapUnits,
    by_angle,
    drawn_unit,
    drawn_units,
    map_holds,
    on_chart,
)
from testbed.analysis.force.force_state import ForceState
from testbed.analysis.information import Z_95
from testbed.analysis.records.inspection_plot import SEGMENT_COLOURS, envelope
from testbed.analysis.records.lines import amplitude_spectrum

KINDS = tuple(SEGMENT_COLOURS)
SYMBOLS = {"natural_frequency": "$f_n$", "damping_ratio": "$\\zeta$", "tangential_coefficient": "$K_t$",
           "normal_coefficient": "$K_n$"}


def save(found: Comparison, folder: Path, tested: Constancy | None = None, states: Sequence[ForceState] = (),
         shown: MapUnits = CALIBRATED, units: Mapping[str, str] | None = None) -> list[Path]:
    """Every picture as PNG and SVG in an existing folder; arguments as of `pictures`."""
    from matplotlib.figure import Figure

    paths = []
    for name, draw in pictures(found, tested, states, shown, units or {}).items():
        figure = Figure(figsize=(10, 5), layout="constrained")
        draw(figure)
        for ending in ("png", "svg"):
            paths.append(folder / f"{name}.{ending}")
            figure.savefig(paths[-1], dpi=120)
    return paths


def pictures(found: Comparison, tested: Constancy | None, states: Sequence[ForceState], shown: MapUnits,
             units: Mapping[str, str]) -> dict[str, Callable[[Any], None]]:
    """The pictures that there are, by name, each a function of the figure to draw on. tested: the base parameters test by test,
    where known; states: force-state maps, drawn in the units `shown`; units: SI or own, by channel, of the records as read."""
    drawn: dict[str, Callable[[Any], None]] = {
        "residual_by_record": lambda figure: by_record(figure, found),
        "worst_record": lambda figure: worst_record(figure, found, units),
        "residual_spectrum": lambda figure: spectrum(figure, found, units)}
    records = found.fitter.records
    if any(record.cut is not None for record in records):
        drawn["residual_by_tooth_angle"] = lambda figure: by_tooth_angle(figure, found)
        if not all(record.forces_only for record in records):
            drawn["misfit_on_chart"] = lambda figure: misfit_on_chart(figure, found)
    if plane := orbits(records, found.errors, units):
        drawn["orbit"] = lambda figure: orbit(figure, plane[0])
    if tested is not None and len(tested.tests) > 1 and tested.parameters:
        drawn["constancy"] = lambda figure: by_test(figure, tested)
    if states:
        drawn["force_state_map"] = lambda figure: force_state_map(figure, states, shown)
    if decays := free_decays(records):
        drawn["amplitude_dependence"] = lambda figure: by_amplitude(figure, decays, units)
    return drawn


def _worst(found: Comparison) -> int:
    """Index of the record with the largest residual in units of its noise."""
    return int(np.argmax([record.chi_square for record in found.records]))


def by_record(figure: Any, found: Comparison) -> None:
    """Residual over noise, a bar for each segment of each record."""
    axis = figure.subplots()
    kinds = [kind for kind in KINDS if any(part.kind == kind for one in found.records for part in one.segments)]
    place = np.arange(len(found.records))
    width = 0.8 / max(len(kinds), 1)
    for number, kind in enumerate(kinds):
        height = [max((part.chi_square for part in one.segments if part.kind == kind), default=np.nan) ** 0.5
                  for one in found.records]
        axis.bar(place - 0.4 + (number + 0.5) * width, height, width, label=kind, color=SEGMENT_COLOURS[kind],
                 edgecolor="#555555", linewidth=0.4)
    if not kinds:
        axis.bar(place, [one.chi_square**0.5 for one in found.records], color="#888888", label="whole record")
    axis.axhline(1.0, color="#d62728", linewidth=0.8, label="the noise")
    axis.set_yscale("log")
    axis.set_xticks(place, [one.name for one in found.records], rotation=45, ha="right")
    axis.set_ylabel("rms of residual / noise [1]")
    axis.set_title("Which records and segments does the model fail to predict?")
    axis.legend(fontsize=8, ncols=6)


def worst_record(figure: Any, found: Comparison, units: Mapping[str, str]) -> None:
    """`one_record` of the worst."""
    one_record(figure, found, _worst(found), units)


def one_record(figure: Any, found: Comparison, index: int, units: Mapping[str, str]) -> None:
    """Measured, predicted and their difference over time, of the first channel; units: SI or own, by channel."""
    from matplotlib.patches import Patch

    record, rest = found.fitter.records[index], found.errors[index].residual[0]
    factor, unit = drawn_unit(record.channels[0], units)
    time = record.start + np.arange(record.samples) / record.rate
    measured = (record.data[0] - record.drift @ (record.drift.T @ record.data[0])) * factor
    rest = rest * factor
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(*envelope(time, measured), linewidth=0.6, color="#333333", label="measured")
    above.plot(*envelope(time, measured - rest), linewidth=0.6, color="#1f77b4", alpha=0.7, label="predicted")
    below.plot(*envelope(time, rest), linewidth=0.6, color="#d62728", label="residual")
    for level in (-2, 2):
        below.axhline(level * record.noise[0] * factor, color="#333333", linewidth=0.8, linestyle="--",
                      label="twice the noise" if level > 0 else None)
    for segment in record.segments:
        for axis in (above, below):
            axis.axvspan(segment.start, segment.stop, color=SEGMENT_COLOURS[segment.kind], alpha=0.5, linewidth=0)
    how = "held out of" if found.records[index].held_out else "in"
    which = "the worst record, " if index == _worst(found) else ""
    above.set_title(f"How far is {record.name} from its prediction? ({which}{how} the fit)")
    above.set_ylabel(f"{record.channels[0]} [{unit}]")
    below.set_ylabel(f"residual [{unit}]")
    below.set_xlabel("time [s]")
    shaded = [kind for kind in KINDS if any(segment.kind == kind for segment in record.segments)]
    handles = [*above.get_legend_handles_labels()[0], *below.get_legend_handles_labels()[0],
               *(Patch(color=SEGMENT_COLOURS[kind], alpha=0.5, label=kind) for kind in shaded)]
    legend = figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=8)
    for handle in legend.legend_handles[:3]:  # lines that are drawn thin
        handle.set_linewidth(1.5)


def by_tooth_angle(figure: Any, found: Comparison) -> None:
    """Mean residual in sectors of the spindle's turn while cutting."""
    axis = figure.subplots()
    for index, record in enumerate(found.fitter.records):
        for view in by_angle(record, found.errors[index], found.fit.state, index)[:1]:
            axis.plot(view.angle, view.mean, linewidth=1, label=record.name)
    axis.set_xlabel("angle since a tooth's entry [deg]")
    axis.set_xlim(0, 360)
    axis.set_ylabel("mean residual / noise [1]")
    axis.set_title("Does what is left depend on the tooth's angle?")
    axis.legend(fontsize=7, ncols=4)


def misfit_on_chart(figure: Any, found: Comparison) -> None:
    """The fitted machine's stability chart, each cut coloured by its error over the noise floor."""
    from matplotlib.colors import LogNorm

    view = on_chart(found.fitter.records, found.errors, found.fit.state.model)
    assert view is not None
    axis, rpm = figure.subplots(), 30.0 / np.pi
    chart = view.chart
    axis.contourf(chart.spindle_speeds * rpm, chart.axial_depths * 1e3, chart.spectral_radius, levels=[1.0, 1e9],
                  colors=["#ddd3ee"])
    points = axis.scatter(view.speeds * rpm, view.depths * 1e3, c=np.maximum(view.ratios, 1.0), s=90, edgecolors="black",
                          norm=LogNorm(1.0, max(10.0, float(view.ratios.max()))), cmap="YlOrRd", zorder=3)
    figure.colorbar(points, label="error / noise floor [1]")
    axis.set_ylim(0, None)
    axis.set_xlabel("spindle speed [rpm]")
    axis.set_ylabel("depth of cut [mm]")
    axis.set_title("Where on the stability chart is the misfit? (violet: unstable by the fitted linear machine)")


def by_test(figure: Any, tested: Constancy) -> None:
    """Base parameters fitted test by test with 95 % intervals, each against the condition it follows best."""
    columns = 2 if len(tested.parameters) > 1 else 1
    rows = -(-len(tested.parameters) // columns)
    figure.set_size_inches(10, 1 + 3.2 * rows)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis in axes[len(tested.parameters):]:
        axis.remove()
    for axis, parameter in zip(axes, tested.parameters, strict=False):
        _tests_of(axis, tested, parameter)
    figure.suptitle("Are the machine's constants constant, fitted test by test?\n"
                    "(95 % intervals; each constant against the condition that it follows best)")


def _tests_of(axis: Any, tested: Constancy, parameter: str) -> None:
    factors = dict(zip(COVARIATES, ((30 / np.pi, "rpm"), (1e3, "mm"), (1e3, "mm"), (1e6, "um s/rad")), strict=True))
    own = [trend for trend in tested.trends if trend.parameter == parameter]
    best = min(own, key=lambda trend: trend.p_value, default=None)
    tests = [test for test in tested.tests if parameter in test.parameters
             and (best is None or best.covariate in test.conditions)]
    estimates = [test.parameters[parameter] for test in tests]
    scale, unit = (1e-6, "N/mm^2") if estimates[0].unit == "N/m^2" else (1.0, estimates[0].unit)
    value, low, high = np.array([(one.value, one.low, one.high) for one in estimates]).T * scale
    if best is None:
        place = np.arange(len(tests), dtype=float)
        axis.set_xticks(place, [test.name for test in tests])
        axis.set_xlabel("test")
    else:
        factor, name = factors[best.covariate]
        place = np.array([test.conditions[best.covariate] for test in tests]) * factor
        axis.set_xlabel(f"{best.covariate} [{name}]")
    axis.errorbar(place, value, [value - low, high - value], fmt="o", markersize=4, capsize=3, color="#1f77b4")
    axis.set_title(f"{parameter}: {tested.short(parameter)}", fontsize=10)
    axis.set_ylabel(f"{SYMBOLS[parameter]} [{unit}]")
    axis.ticklabel_format(axis="y", useOffset=False)


def orbit(figure: Any, one: Orbit) -> None:
    """Motion along y over motion along x amid steady cutting."""
    axis = figure.subplots()
    for name, values, colour in (("measured", one.measured, "#333333"), ("predicted", one.predicted, "#1f77b4")):
        axis.plot(*values, linewidth=0.8, color=colour, label=name, alpha=0.8)
    axis.set_aspect("equal", adjustable="datalim")
    axis.set(xlabel=f"along x, the feed [{one.unit}]", ylabel=f"along y [{one.unit}]",
             title=f"Does the motion turn as predicted?\n{one.name}, {one.quantity}: {one.noise:.2f} times the noise is left")
    axis.legend(fontsize=8)


def by_amplitude(figure: Any, decays: Sequence[AmplitudeDependence], units: Mapping[str, str]) -> None:
    """Frequency and damping ratio of the free decays against their amplitude; units: SI or own, by channel."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    left, right = figure.subplots(1, 2)
    factors, labels, unit = drawn_units(decays, units)
    for one, factor, label in zip(decays, factors, labels, strict=True):
        fine = np.geomspace(one.amplitude.min(), one.amplitude.max(), 50)
        for axis, values, errors, law in ((left, one.frequency, one.frequency_error, one.frequency_at(fine)),
                                          (right, one.damping, one.damping_error, one.damping_at(fine))):
            drawn = axis.errorbar(one.amplitude * factor, values, Z_95 * errors, fmt=".", linewidth=0.7, label=label)
            axis.plot(fine * factor, law, color=drawn[0].get_color(), linewidth=0.8)
    for axis, name in ((left, "frequency [Hz]"), (right, "damping ratio [1]")):
        axis.set_xscale("log")
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.xaxis.set_minor_formatter(NullFormatter())
        axis.set_xlabel(f"amplitude [{unit}]")
        axis.set_ylabel(name)
        axis.ticklabel_format(axis="y", useOffset=False)
    left.legend(fontsize=7, ncols=2)
    figure.suptitle("Do frequency and damping depend on the amplitude of free vibration?")


def force_state_map(figure: Any, states: Sequence[ForceState], shown: MapUnits = CALIBRATED) -> None:
    """The missing force over displacement and velocity; out of the cut, where it is one of the motion alone, before in the
    cut, each with a scale of colour of its own, since an error of the chip force is often the larger by far."""
    states = sorted(states, key=lambda one: "while a tooth cuts" in one.name)
    columns = min(2, len(states))  # a scale of colour is between
    axes = figure.subplots(-(-len(states) // columns), columns, squeeze=False, gridspec_kw={"wspace": 0.1}).ravel()
    for axis in axes[len(states):]:
        axis.remove()
    across, up, colour = shown
    for axis, one in zip(axes, states, strict=False):
        reach = (float(np.percentile(np.abs(one.force), 99)) or 1.0) * colour[0]
        points = axis.scatter(one.x * across[0], one.v * up[0], c=one.force * colour[0], s=6, cmap="coolwarm", vmin=-reach,
                              vmax=reach, linewidths=0)
        axis.set_xlabel(f"displacement [{across[1]}]")
        axis.set_ylabel(f"velocity [{up[1]}]")
        axis.set_title("\n".join(part for part in (one.name, map_holds(one.name)) if part), fontsize=10)
        figure.colorbar(points, ax=axis, label=f"missing force [{colour[1]}]")
    figure.suptitle("What does the missing force depend on: displacement or velocity?")


def spectrum(figure: Any, found: Comparison, units: Mapping[str, str]) -> None:
    """Amplitude spectrum of the worst record's residual, tooth-passing harmonics and natural frequency marked.

    units: SI or own, by channel.
    """
    axis = figure.subplots()
    index = _worst(found)
    record = found.fitter.records[index]
    factor, unit = drawn_unit(record.channels[0], units)
    frequencies, amplitude = amplitude_spectrum(found.errors[index].residual[0] * factor, record.rate)
    axis.semilogy(*envelope(frequencies[1:], np.maximum(amplitude[1:], 1e-300)), linewidth=0.6, color="#333333",
                  label="residual")
    structure = found.fit.state.model.structure
    slowest, fastest = structure.frequency_range
    highest = min(frequencies[-1], max(8 * slowest, 2 * fastest))
    for place, mode in enumerate(structure.modes):
        axis.axvline(mode.natural_frequency, color="#1f77b4", linewidth=1, label="natural frequency" if place == 0 else None)
    if record.cut is not None:
        tooth = record.flutes / record.period
        for order in range(1, int(highest / tooth) + 1):
            axis.axvline(order * tooth, color="#2ca02c", linewidth=0.7, linestyle=":",
                         label="tooth passing and harmonics" if order == 1 else None)
    axis.set_xlim(0, highest)
    axis.set_xlabel("frequency [Hz]")
    axis.set_ylabel(f"residual of {record.channels[0]}, amplitude [{unit}]")
    axis.set_title(f"At which frequencies does the model miss {record.name}?")
    axis.legend(loc="upper right", fontsize=8)
