"""An outside campaign as the files that a user has: records, campaign.yaml and model.yaml."""

from __future__ import annotations

import math
from pathlib import Path

import h5py
import numpy as np
from ruamel.yaml import YAML

from tests.validation.outside.plan import LONGEST, Plan, Test
from tests.validation.outside.simulator import TURN, run, sampled

PULSE = 0.5  # rad of the spindle's turn that a tachometer's pulse lasts
SPIKE, STUCK = 60.0, 12  # standard deviations of the noise; samples
VOLTS, VOLT_NOISE = 5.0, 0.03


def write(plan: Plan, folder: Path) -> None:
    """The whole campaign in a folder of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    records = []
    for number, test in enumerate(plan.tests):
        displacement, volts = _measured(plan, number, test)
        name = f"cut_{number + 1}.{'h5' if plan.sensors.form == 'hdf5' else 'csv'}"
        _record(plan, folder / name, displacement, volts)
        records.append({"file": name, "kind": "cut", "spindle_speed": f"{test.rpm} rpm",
                        "depth_of_cut": f"{test.cut.depth * 1e3:.6g} mm", "feed": _feed(plan, test)})
    campaign = {"name": f"outside {plan.seed}", "channels": _channels(plan), "records": records}
    if plan.sensors.form == "csv":
        campaign["sampling_rate"] = f"{plan.sensors.rate} Hz"
    YAML().dump(campaign, folder / "campaign.yaml")
    YAML().dump(_model(plan), folder / "model.yaml")


def _feed(plan: Plan, test: Test) -> str:
    flutes = plan.base.flutes
    return {"tooth": f"{test.feed * 1e3:.6g} mm/tooth", "revolution": f"{test.feed * flutes * 1e3:.6g} mm/rev",
            "minute": f"{test.feed * flutes * test.rpm * 1e3:.6g} mm/min"}[plan.sensors.feed_form]  # fmt: skip


def _channels(plan: Plan) -> dict:
    displacement, volts = {
        "csv": ({"column": "disp_um", "unit": "um"}, {"column": "tach_V", "unit": "V"}),
        "times": ({"column": "Displacement"}, {"column": "Tacho"}),
        "hdf5": ({"column": "disp"}, {"column": "tach"}),
    }[plan.sensors.form]
    marked = plan.sensors.tachometer != "none"
    return {"displacement": displacement} | ({"tachometer": volts | {"pulses_per_revolution": 1}} if marked else {})


def _model(plan: Plan) -> dict:
    believed, base = plan.believed, plan.base
    return {
        "structure": {"mass": f"{base.mass:.9g} kg", "natural_frequency": f"{believed['omega'] / TURN:.6g} Hz",
                      "damping_ratio": float(f"{believed['zeta']:.4g}")},
        "cutter": {"flutes": base.flutes, "diameter": f"{2e3 * base.radius:.9g} mm", "helix_angle": "0 deg"},
        "cutting": {"direction": plan.direction, "immersion": float(f"{plan.immersion:.12g}"),
                    "tangential_coefficient": f"{believed['kt'] * 1e-6:.5g} N/mm^2",
                    "normal_coefficient": f"{believed['kn'] * 1e-6:.5g} N/mm^2"},
    }  # fmt: skip


def _measured(plan: Plan, number: int, test: Test) -> tuple[np.ndarray, np.ndarray]:
    """(displacement (n,) m, tachometer (n,) V) as the sensors give them, with offset, drift, noise and faults."""
    sensors, random = plan.sensors, np.random.default_rng([1906, plan.seed, number])
    times, angles, seen, _ = run(test.cut, *test.state, test.duration, LONGEST)
    at = np.arange(0.0, test.duration - 1e-6, 1.0 / sensors.rate)
    clean, angle = sampled(times, angles, seen, at)
    noise = sensors.noise
    signal = clean + noise * (random.standard_normal(len(at)) + 5.0 * random.standard_normal() + 20.0)
    signal += 2.0 * noise * np.sin(TURN * random.uniform(0.05, 0.15) * at + random.uniform(0.0, TURN))
    signal += sensors.hum * np.sin(TURN * 50.0 * at + random.uniform(0.0, TURN))
    if sensors.bits:
        span = 2.6 * np.abs(signal).max() / 2**sensors.bits
        signal = np.round(signal / span) * span
    if sensors.spike and number == 2:
        signal[len(at) // 2] += SPIKE * noise
    if sensors.stuck and number == 1:
        first = int(0.6 * len(at))
        signal[first : first + STUCK] = signal[first]
    begins = 0
    if sensors.late and number == len(plan.tests) - 1:
        begins = int((test.cut.begin + sensors.late * (test.cut.end - test.cut.begin)) * sensors.rate)
    return signal[begins:], _volts(plan, test, angle, random)[begins:]


def _volts(plan: Plan, test: Test, angle: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """A pulse a turn; its edges last a sample (digital), about one (pulse) or several (soft)."""
    phase = (angle - plan.sensors.mark_angle) % TURN
    a_sample = test.cut.speed / plan.sensors.rate
    if plan.sensors.tachometer == "digital":
        level = np.where(phase < PULSE, 1.0, 0.0)
    else:
        rise = 5.0 * a_sample if plan.sensors.tachometer == "soft" else max(0.01, a_sample)
        width = max(PULSE, 2.0 * rise)
        level = np.clip(phase / rise, 0.0, 1.0) - np.clip((phase - width) / rise, 0.0, 1.0)
    return VOLTS * level + VOLT_NOISE * random.standard_normal(len(angle))


def _record(plan: Plan, path: Path, displacement: np.ndarray, volts: np.ndarray) -> None:
    sensors, marked = plan.sensors, plan.sensors.tachometer != "none"
    columns = [displacement * {"csv": 1e6, "times": 1e3, "hdf5": 1.0}[sensors.form], *([volts] if marked else [])]
    if sensors.form == "hdf5":
        with h5py.File(path, "w") as file:
            file.attrs["sampling_rate"] = sensors.rate
            for name, unit, values in zip(("disp", "tach"), ("m", "V"), columns, strict=False):
                file.create_dataset(name, data=values).attrs["units"] = unit
    elif sensors.form == "csv":
        digits = 3 + max(0, math.ceil(-math.log10(sensors.noise * 1e6)))
        head = ",".join(["disp_um", "tach_V"][: len(columns)])
        forms = [f"%.{digits}f", "%.3f"][: len(columns)]
        np.savetxt(path, np.stack(columns, 1), fmt=forms, delimiter=",", header=head, comments="")
    else:
        times = np.arange(len(displacement)) / sensors.rate
        digits = 6 + max(0, math.ceil(-math.log10(sensors.noise * 1e6)))
        head = ";".join(["Time [s]", "Displacement [mm]", "Tacho [V]"][: 1 + len(columns)])
        forms = ["%.7f", f"%.{digits}f", "%.3f"][: 1 + len(columns)]
        np.savetxt(path, np.stack([times, *columns], 1), fmt=forms, delimiter=";", header=head, comments="")
