"""Diagnosis beyond simulated cuts: real hardware, free decays alone (integrated by scipy), and campaigns of garbage."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.integrate import solve_ivp

from analysis.fit.observed import observe
from analysis.fit.prediction import predict as predict_forces
from analysis.search.diagnose import diagnose
from analysis.search.diagnosis import Candidate, Diagnosis
from testbed.campaign import Record, load_campaign
from testbed.catalogue import catalogue
from testbed.cli.diagnose import MANY
from testbed.engines import mujoco_engine, predict
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.recording import Recording
from tests.validation.claims import Claim, Section

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from campaign_files import BELIEVED, TRUE  # noqa: E402
from real_data import MANIFESTS, MEASUREMENTS  # noqa: E402
from synthetic_campaign import TESTS, synthetic_campaign  # noqa: E402

PLANT = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict.predict_driven)
MASS, OMEGA, ZETA = 2.573, 920.0, 0.0032
LAWS: dict[str, tuple[Callable, str]] = {
    "no further force": (lambda x, v: 0.0 * x, "adequate"),
    "-2e13 x^3": (lambda x, v: -2e13 * x**3, "cubic_stiffness"),
    "-0.3 sign(v)": (lambda x, v: -0.3 * np.tanh(v / 1e-5), "dry_friction"),
    "-60 |v| v": (lambda x, v: -60 * abs(v) * v, "quadratic_damping"),
}


def told(records: list[Record], believed: Model, **more: int) -> Diagnosis:
    """The diagnosis of some records."""
    return diagnose(PLANT, [observe(record, believed) for record in records], believed, catalogue(), **more)


def answer(found: Diagnosis) -> str:
    """Verdict and names in a few words."""
    return f"{found.verdict}: {' + '.join(found.effects)}" if found.effects else found.verdict


def free_decay(force: Callable, amplitude: float, seed: int) -> Record:
    """Two seconds of free vibration at 12.8 kHz after some idling, 1 um noise, integrated by scipy."""
    time = np.arange(25600) / 12800.0

    def slope(t, y):
        return [y[1], -2 * ZETA * OMEGA * y[1] - OMEGA**2 * y[0] + force(y[0], y[1]) / MASS]

    motion = solve_ivp(slope, (0, 2), [amplitude, 0.1], t_eval=time, rtol=1e-9, atol=1e-13, method="LSODA").y[0]
    signal = np.concatenate([np.zeros(2000), motion]) + 1e-6 * np.random.default_rng(seed).standard_normal(27600) + 3e-6
    recording = Recording({"displacement": signal}, 12800.0, {"displacement": "m"}, "synthetic")
    return Record(f"tap {seed}", "ring-down", recording, {}, ())


def decays() -> tuple[list[Claim], list[tuple[str, ...]]]:
    """Free decays alone."""
    claims, rows = [], []
    believed = Model(Structure(MASS, 150.0, 0.005))
    for law, (force, wanted) in LAWS.items():
        found = told([free_decay(force, size, seed) for seed, size in enumerate((2e-4, 1.2e-4, 3e-4))], believed)
        right = found.verdict == wanted if wanted == "adequate" else found.effects == (wanted,)
        claims.append(Claim(f"three free decays alone, {law}", wanted, answer(found), right))
        rows.append((law, answer(found), f"{found.baseline / found.noise_floor:.2f}",
                     f"{found.with_effects / found.noise_floor:.3f}",
                     ", ".join(f"{path} {value:.4g}" for path, value in found.best.parameters.items())))
    return claims, rows


def garbage() -> tuple[Claim, list[tuple[str, ...]]]:
    """Campaigns that no model should be blamed for: in how many is an effect named."""
    sound = synthetic_campaign(mujoco_engine.simulate, TRUE, seed=11, tests=TESTS[:4])
    random = np.random.default_rng(5)

    def changed(change: Callable[[np.ndarray], np.ndarray]) -> list[Record]:
        return [replace(one, recording=replace(one.recording, channels={
            "displacement": change(one.recording.channels["displacement"])})) for one in sound]

    def swapped() -> list[Record]:
        return [replace(one, conditions=other.conditions,
                        recording=replace(one.recording, marks=np.empty(0), conditions=other.conditions))
                for one, other in zip(sound, sound[1:] + sound[:1], strict=True)]

    kinds = {
        "pure noise": changed(lambda x: 1e-6 * random.standard_normal(len(x))),
        "the signal backwards": changed(lambda x: x[::-1].copy()),
        "clipped at a third of its range": changed(lambda x: np.clip(x, -0.33 * np.ptp(x) / 2, 0.33 * np.ptp(x) / 2)),
        "every sample of another time": changed(lambda x: x[random.permutation(len(x))]),
        "sign of every second record changed": [replace(one, recording=replace(one.recording, channels={
            "displacement": (-1) ** k * one.recording.channels["displacement"]})) for k, one in enumerate(sound)],
        "conditions swapped, no tachometer": swapped(),
    }
    rows = []
    for name, records in kinds.items():
        try:
            found = answer(told(records, BELIEVED))
        except ValueError as problem:
            found = f"refused: {problem}"
        rows.append((name, found))
    named = [row for row in rows if row[1].startswith(("missing_effect", "undecided:"))]  # without a name it blames none
    claim = Claim("campaigns of garbage in which an effect is named missing", "0", f"{len(named)} of {len(rows)}", not named)
    return claim, rows


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
    of_decays, decay_rows = decays()
    of_garbage, garbage_rows = garbage()
    of_hardware, hardware_rows = hardware()
    return Section(
        "Diagnosis: real hardware, free decays alone, garbage",
        (*of_hardware, *of_decays, of_garbage),
        (("Real hardware, step by step", ("measurement", "model", "held out, pooled", "by record"), tuple(hardware_rows)),
         ("Free decays alone", ("force", "answer", "error / noise before", "after", "parameters"), tuple(decay_rows)),
         ("Garbage", ("campaign", "answer"), tuple(garbage_rows))),
    )
