"""Diagnosis beyond simulated cuts: free decays alone (integrated by scipy), and campaigns of garbage."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from scipy.integrate import solve_ivp

from testbed.analysis.fit.observe import observe
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.diagnosis import Diagnosis
from testbed.catalogue import catalogue
from testbed.engines import mujoco_engine, predict
from testbed.files.campaign import Record
from testbed.machine import Model, Structure
from testbed.recording import Recording
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import TESTS, synthetic_campaign
from tests.validation.claims import Claim, Section

ENGINE = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict.predict_driven)
MASS, OMEGA, ZETA = 2.573, 920.0, 0.0032
LAWS: dict[str, tuple[Callable, str]] = {
    "no further force": (lambda x, v: 0.0 * x, "adequate"),
    "-2e13 x^3": (lambda x, v: -2e13 * x**3, "cubic_stiffness"),
    "-0.3 sign(v)": (lambda x, v: -0.3 * np.tanh(v / 1e-5), "dry_friction"),
    "-60 |v| v": (lambda x, v: -60 * abs(v) * v, "quadratic_damping"),
}


def told(records: list[Record], believed: Model, **more: int) -> Diagnosis:
    """The diagnosis of some records."""
    return diagnose(ENGINE, [observe(record, believed) for record in records], believed, catalogue(), **more)


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


def check() -> Section:
    """Run both."""
    of_decays, decay_rows = decays()
    of_garbage, garbage_rows = garbage()
    return Section(
        "Diagnosis: free decays alone, garbage",
        (*of_decays, of_garbage),
        (("Free decays alone", ("force", "answer", "error / noise before", "after", "parameters"), tuple(decay_rows)),
         ("Garbage", ("campaign", "answer"), tuple(garbage_rows))),
    )
