"""What a user is misled by: each effect at its example value, left out of the model that is fitted.

The base model is refitted to three stable cuts in which one effect hides (fast engine, 1 um noise, unknown tachometer
angle, offset and drift). Shown: how wrong the base parameters come out, and how large the residual is beside the noise.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from testbed.analysis.fit.first_passes import first_nuisances
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.solve import alternate_fit_and_passes
from testbed.analysis.fit.starts import base_fit
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from testbed.machine import Cutter
from tests.support.synthetic_campaign import MARK_ANGLE, synthetic_campaign
from tests.validation.claims import FLEXURE, Claim, Section

TESTS = ((3810, 2.9), (2850, 1.5), (4200, 1.5))
TWO_TEETH = ((3810, 1.5), (3300, 1.5), (4200, 1.5))  # stable with two teeth: |mu| from 0.79 to 0.93
NOISE = 1e-6  # m
SILENT = "contact_loss says nothing in a stable cut: its row is the one without effect; runout is cut with two teeth"
NAMES = (("damping_ratio", "zeta"), ("natural_frequency", "omega_n"), ("tangential_coefficient", "K_t"),
         ("normal_coefficient", "K_n"))
ENGINE = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict.predict_driven)


def percent(relative: float) -> str:
    """A signed percentage with two digits, none after the point where it is large."""
    value = 100.0 * relative
    return f"{value:+.0f} %" if abs(value) >= 10 else f"{value:+.2g} %"


def left_out(name: str | None) -> tuple[dict[str, float], float]:
    """(relative errors of the base parameters, residual rms in units of the noise) with an effect left out, or none."""
    base, tests = (replace(FLEXURE, cutter=Cutter(2)), TWO_TEETH) if name == "runout" else (FLEXURE, TESTS)
    truth = base if name is None else base.with_effect(name, **catalogue()[name].example())
    records = [observe(record, base) for record in synthetic_campaign(fast.simulate, truth, tests=tests, noise=NOISE)]
    fitter, fit = base_fit(ENGINE, records, base)
    known = State(base, MARK_ANGLE, tuple(first_nuisances(record, MARK_ANGLE) for record in records))
    # a user's fit may end worse: this is the best there is
    fit = min(fit, alternate_fit_and_passes(fitter, known), key=lambda one: one.cost)
    errors = {path: fit.state.model.value(path) / base.value(path) - 1.0 for path, _ in NAMES}
    squares = sum(float(np.sum((rest.reshape(record.data.shape) * record.noise[:, None]) ** 2))
                  for rest, record in zip(fit.residuals, records, strict=True))
    return errors, float(np.sqrt(squares / sum(record.samples for record in records))) / NOISE


def check() -> Section:
    """The section of the table."""
    rows, failures, none = [], [], {}
    for name in (None, *catalogue()):
        try:
            errors, residual = left_out(name)
        except (ValueError, ArithmeticError) as problem:
            failures.append(f"{name}: {problem}")
            continue
        if name is None:
            none = {"errors": errors, "residual": residual}
        rows.append((name or "none", *(percent(errors[path]) for path, _ in NAMES), f"{residual:.3g}"))
    worst = max(abs(value) for value in none["errors"].values())
    claims = (
        Claim("nothing left out: the base parameters come back", "within 2 %", f"{100 * worst:.2g} %", worst < 0.02),
        Claim("nothing left out: residual in units of the noise", "0.95 to 1.05", f"{none['residual']:.3f}",
              0.95 < none["residual"] < 1.05),
        Claim("every effect has its row", str(len(catalogue()) + 1), str(len(rows)), not failures,
              "; ".join(failures) or SILENT),
    )
    title = "Error of each parameter when the effect is left out, and the residual in units of 1 um noise"
    return Section("Absorption: what an effect left out does to the others", claims,
                   ((title, ("left out", *(symbol for _, symbol in NAMES), "residual"), tuple(rows)),))
