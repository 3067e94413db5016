"""One cut of a machine, simulated and recorded by its sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from testbed.api.believed import EffectsLike, ModelLike, cutting_model, effects_of
from testbed.api.inspect import sampling_rate
from testbed.api.multipliers import FEED
from testbed.api.quantity import DEPTH, SPEED, Quantity, positive, quantity
from testbed.api.sweep import Engine, engine_named
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from testbed.recording import Recording
    from testbed.sensors.chain import SensorChain

MOST_SAMPLES = 50_000_000  # of one run


def simulate(model: ModelLike, speed: Quantity, depth: Quantity, *, feed: Quantity = FEED,
             revolutions: tuple[float, float, float] = (10, 60, 30), rate: Quantity = "12800 Hz",
             channels: Sequence[str] = ("displacement",), noise: Quantity | Mapping[str, Quantity] = 0.0,
             engine: Engine = "fast", seed: int = 0, effects: EffectsLike = ()) -> Recording:
    """Simulate one cut: idling, entry, cutting, exit and ring-down. The same samples as that test in a scenario gives, in
    double precision.

    model: a model.yaml or a Model, effects and all. speed: `"3810 rpm"`, or rad/s. depth: `"2.9 mm"`, or m. feed:
    `"0.1 mm/tooth"`, or m. revolutions: of idling, cutting and ringing down. rate: of the sensors, `"12800 Hz"` or Hz.
    channels: `displacement`, `velocity_y`, `acceleration`, `force_x`, ... noise: white, rms, `"0.5 um"` or SI, of all channels
    or by channel. engine: `fast` (compiled) or `mujoco` (the reference). seed: of the noise. effects: folders of one's own
    effects. A run that diverges says so in `outcome`. Raises InputProblem.
    """
    from testbed.cut import whole_cut_sampling
    from testbed.scenario.design import OperatingPoint
    from testbed.scenario.scenario import Course, Scenario, whole_passes
    from testbed.sweeps.batch import simulate_run

    with working():
        own = effects_of(effects)
        at, deep, advance = SPEED.one(speed, "speed"), DEPTH.one(depth, "depth"), positive(feed, "m/tooth", "feed")
        believed, _ = cutting_model(model, own.known)
        assert believed.cutter is not None  # or it were refused
        try:
            idle, passes, rest = (whole_passes(float(count), "revolutions", believed.cutter.flutes) for count in revolutions)
            if idle + passes + rest == 0:
                raise ValueError("is over before it begins")
        except (TypeError, ValueError) as problem:
            raise InputProblem("revolutions", f"{revolutions}: {problem}", "give three numbers, such as (10, 60, 30)") from None
        scenario = Scenario("simulate", believed, (OperatingPoint(at, deep),), Course(advance, idle, passes, rest),
                            (_sensors(channels, noise),), sampling_rate(rate, "rate"), seed=seed, engine=engine)
        run = scenario.run(0)
        count = whole_cut_sampling(run.cut, believed.cutter.flutes, run.sampling.rate).count
        if count > MOST_SAMPLES:
            raise InputProblem("revolutions", f"{count} samples", f"give at most {MOST_SAMPLES}: fewer, or a lower rate")
        return simulate_run(run, engine_named(engine), own.known)


def _sensors(channels: Sequence[str], noise: Quantity | Mapping[str, Quantity]) -> SensorChain:
    """A sensor for each channel. InputProblem where there is no such channel."""
    from testbed.recording import CHANNEL_UNITS, MOTIONS
    from testbed.sensors.chain import ChannelSensor, SensorChain
    from testbed.units import nearest

    names, known = (channels,) if isinstance(channels, str) else tuple(channels), (*MOTIONS, "force_x", "force_y")
    if not names:
        raise InputProblem("channels", "none is named", f"give of {', '.join(known)}")
    levels = dict(noise) if isinstance(noise, Mapping) else dict.fromkeys(names, noise)
    for name in (*names, *levels):
        if name not in known or name not in names:
            there = names if name in known else known
            close = nearest(name, there)
            raise InputProblem("channels", f"there is no '{name}'", f"did you mean {close}?" if close else ", ".join(there))
    sensors = {}
    for name in names:
        level = quantity(levels.get(name, 0.0), CHANNEL_UNITS[name], f"noise of {name}")
        try:
            sensors[name] = ChannelSensor(level)
        except ValueError as problem:
            raise InputProblem(f"noise of {name}", str(problem), "correct the value") from None
    return SensorChain(sensors)
