"""The page of `testbed compare`: where the believed model, refitted, fails, and how."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from testbed.analysis.comparison.amplitude import free_decays
from testbed.analysis.comparison.compare import Comparison
from testbed.analysis.comparison.constancy import Constancy, constancy
from testbed.analysis.comparison.orbit import orbits
from testbed.analysis.comparison.residual_views import map_units
from testbed.analysis.fit.estimates import said_at_bound
from testbed.analysis.report.chart import add_chart
from testbed.analysis.report.constants import add_amplitude, add_constancy
from testbed.analysis.report.force_map import add_force_map
from testbed.analysis.report.machine import add_nuisances, add_parameters
from testbed.analysis.report.orbit import add_orbits
from testbed.analysis.report.page import Page
from testbed.analysis.report.residuals import add_angle, add_records, add_spectrum
from testbed.analysis.report.waveforms import add_waveforms, looks, worst_first
from testbed.analysis.search.diagnosis import judged_on
from testbed.effect import Effect
from testbed.machine import Model

INTRODUCTION = (
    "This page puts what was measured beside what the model predicts. The error is the rms of their difference over the rms "
    "of what was measured; the noise floor is the error that noise alone leaves. Dark lines are measured, blue ones predicted, "
    "red ones the difference. Wide tables and pictures scroll sideways."
)
ForceMap = tuple[str, np.ndarray, np.ndarray, np.ndarray]  # name of a record, x (m), v (m/s), force (N), (n,) each


def verdict_of(found: Comparison) -> str:
    """The comparison in one sentence."""
    ratio = found.error / max(found.noise_floor, 1e-300)
    held = judged_on(found.records[0].held_out)
    if found.says_nothing:
        return "Almost only noise was measured, which does not test the model."
    if found.adequate:
        return (
            f"The refitted model explains every record down to its noise: error {found.error:.3g} {held}, "
            f"{ratio:.2f} times the noise floor."
        )
    worst = max(found.records, key=lambda one: one.chi_square)
    if found.slight:
        return (
            f"The refitted model leaves little more than noise: error {found.error:.3g} {held}, {ratio:.3f} times the noise "
            f"floor; the worst record is {worst.name}. testbed diagnose says whether a known effect lowers it."
        )
    return (
        f"The refitted model leaves more than noise: error {found.error:.3g} {held}, {ratio:.2f} times the noise floor "
        f"of {found.noise_floor:.3g}; the worst record is {worst.name}. What it lacks may bend its "
        f"parameters beyond their intervals; testbed diagnose says whether an effect is missing."
    )


def compare_page(
    found: Comparison,
    believed: Model,
    catalogue: Mapping[str, Effect],
    units: Mapping[str, str],
    *,
    name: str = "",
    notes: Sequence[str] = (),
    force_maps: Sequence[ForceMap] = (),
    tested: Constancy | None = None,
) -> Page:
    """The whole page. units: SI or own, by channel; tested: the constancy, where it is known already."""
    records, errors, fit = found.fitter.records, found.errors, found.fit
    page = Page(f"Where does the model fail?{' ' + name if name else ''}")
    page.verdict(verdict_of(found), None if found.says_nothing else found.adequate)
    failing = {test.record for test in found.tests if test.fails}
    page.tiles(
        (
            ("error, held out" if found.records[0].held_out else "error, in the fit", f"{found.error:.4f}"),
            ("noise floor", f"{found.noise_floor:.4f}"),
            ("error / noise floor", f"{found.error / found.noise_floor:.2f}"),
            ("records beyond their noise", f"{len(failing)} of {len(records)}"),
        )
    )
    page.text(INTRODUCTION, small=True)
    for note in (*notes, *((said_at_bound(found.at_bound),) if found.at_bound else ())):
        page.text(note, small=True)
    chosen = worst_first(looks(records, units), errors)
    add_records(page, found.records, found.tests)
    add_waveforms(page, chosen, errors)
    add_orbits(page, orbits(records, errors, units))
    add_angle(page, chosen, errors, fit.state, found.tests)
    add_spectrum(page, chosen, errors, fit.state)
    for one, x, v, force in force_maps:
        add_force_map(page, one, x, v, force, shown=map_units(units))
    if any(not channel.startswith("force") for record in records for channel in record.channels):
        add_chart(page, records, errors, fit.state.model)
    add_constancy(page, tested or constancy(found.fitter, fit, catalogue), found.parameters)
    add_amplitude(page, free_decays(records), units)
    add_parameters(page, found.parameters, believed, fit.converged, found.at_bound)
    add_nuisances(page, found.records, found.nuisances, units)
    return page
