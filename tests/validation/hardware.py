"""Diagnosis of real hardware: a nonlinear oscillator, a tap test and milling forces, step by step."""

from __future__ import annotations

import numpy as np

from testbed.analysis.fit.prediction import predict as predict_forces
from testbed.analysis.search.diagnosis import Candidate
from testbed.api.diagnose import MANY
from testbed.files.campaign import Record, load_campaign
from testbed.machine import Cutter, Cutting, Model, Structure
from tests.support.real_data import MANIFESTS, MEASUREMENTS
from tests.validation.claims import Claim, Section
from tests.validation.diagnosis import answer, told


def hardware() -> tuple[list[Claim], list[tuple[str, ...]]]:
    """The real measurements; nothing where they are absent."""
    believed = {
        "silverbox": Model(Structure(5e-6, 70.0, 0.03)),
        "tap_test": Model(Structure(1.0, 1000.0, 0.03)),
        "milling_force": Model(Structure(1.0, 5000.0, 0.02), Cutter(flutes=2, diameter=0.025),
                               Cutting("up-milling", 0.5, 8e8, 3e8)),
    }
    claims, rows = [], []
    for name, model in believed.items():
        if not (MEASUREMENTS / name).is_dir():
            claims.append(Claim(name, "measured", "absent", None, "the real measurements are not here"))
            continue
        records = list(load_campaign(MANIFESTS / f"{name}.yaml", MEASUREMENTS).records)
        found = told(records, model, **({"most": MANY} if name == "milling_force" else {}))  # as by --until-adequate
        for step in found.steps:
            rows.append((name, " + ".join(step.effects) or "refitted, no effect", f"{step.error_held_out:.4f}",
                         ", ".join(f"{one.name} {one.error:.4f}" for one in step.errors)))
        last = {one.name: one.error for one in found.best.errors}
        if name == "silverbox":
            claims.append(Claim("silverbox", "cubic_stiffness", answer(found), found.effects == ("cubic_stiffness",)))
            claims += [Claim(f"silverbox, {one}: held-out error", f"<= {most}", f"{last[one]:.4f}", last[one] <= most)
                       for one, most in (("multisine", 0.02), ("arrow", 0.035))]
            continue
        most = {"tap_test": 0.18, "milling_force": 0.35}[name]
        claims.append(Claim(f"{name}: held-out error after the named effects", f"<= {most}",
                            f"{found.with_effects:.3f} ({answer(found)})", found.with_effects <= most,
                            f"from {found.baseline:.3f}"))
        if name == "milling_force":
            wanted = ("runout", "edge_force", "second_mode")
            claims.append(Claim("milling_force: what is missing is named, in any order", ", ".join(wanted), answer(found),
                                set(wanted) <= set(found.effects)))
            plain = next(step for step in found.steps if set(step.effects) == {"runout", "edge_force"})
            claims.append(Claim("milling_force: error that any linear dynamometer would leave of runout + edge_force", "-",
                                f"{any_linear_dynamometer(plain):.3f}", None,
                                "in the fit, a free answer at every harmonic: more is asked for by the highest feeds"))
            before, after = (by_whole_signal(records, one) for one in (found.base, found.best))
            claims.append(Claim("milling_force: held-out rms of the residual over that of the forces, means and all",
                                f"from 0.59 to <= {most}", f"from {before:.3f} to {after:.3f}", after <= most,
                                "the division that 0.59 is by; the error above is by the forces about their mean"))
    return claims, rows


def any_linear_dynamometer(step: Candidate) -> float:
    """Error that would be left of the forces predicted by a step, had the dynamometer any linear answer whatever.

    One complex factor for every harmonic of the spindle and channel, the best for all records; what does not repeat is left.
    """
    assert step.fit is not None and step.fitter is not None
    state, left, whole = step.fit.state, 0.0, 0.0
    per_record = []
    for record, own in zip(step.fitter.records, state.nuisances, strict=True):
        turn = record.period / own.speed * record.rate  # samples
        forces = predict_forces(step.fitter.plant, record, [(state.model, state.angle, own)])[0]
        per_record.append([(_harmonics(seen, turn), _harmonics(told, turn)[0])
                           for seen, told in zip(record.data, forces, strict=True)])
        whole += float(np.sum(record.data.var(axis=1)))
    for channel in zip(*per_record, strict=True):
        count = min(len(told) for _, told in channel)
        seen = np.array([lines[:count] for (lines, _), _ in channel])
        told = np.array([lines[:count] for _, lines in channel])
        answer = np.sum(seen * told.conj(), axis=0) / np.sum(abs(told) ** 2, axis=0)
        left += float(np.sum(0.5 * abs(seen - answer * told) ** 2)) + sum(rest for (_, rest), _ in channel)
    return (left / whole) ** 0.5


def _harmonics(values: np.ndarray, turn: float) -> tuple[np.ndarray, float]:
    """(complex amplitude at every multiple of the spindle's frequency, variance of what is left); turn in samples."""
    angle = 2.0 * np.pi * np.arange(len(values))[:, None] / turn * np.arange(1, int(turn / 2.0))
    columns = np.hstack([np.ones((len(values), 1)), np.cos(angle), np.sin(angle)])
    found, *_ = np.linalg.lstsq(columns, values, rcond=None)
    cosines, sines = np.split(found[1:], 2)
    return cosines - 1j * sines, float(np.var(values - columns @ found))


def by_whole_signal(records: list[Record], one: Candidate) -> float:
    """rms(measured - predicted) / rms(measured), means and all, pooled over the records."""
    forces = [record.recording.channels[name] for record in records for name in ("force_x", "force_y")]
    return (sum(error.squares for error in one.errors) / sum(float(force @ force) for force in forces)) ** 0.5


def check() -> Section:
    """Run all three."""
    claims, rows = hardware()
    return Section(
        "Diagnosis: real hardware",
        tuple(claims),
        (("Step by step", ("measurement", "model", "held out, pooled", "by record"), tuple(rows)),),
    )
