"""The fast engine on machines that move in the plane, against a road of its own and against what must hold."""

import math
from dataclasses import replace

import numpy as np
import pytest

from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling, whole_cut_sampling
from testbed.engines import fast, mujoco_engine
from testbed.engines.predict import predict_cuts
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from testbed.problem import InputProblem
from testbed.recording import MOTION_UNITS
from tests.support.plane_road import Road

RATE = 8000.0
FLEXURE = Structure(2.573, 146.4, 0.0032)
MACHINE = Structure.of([Mode(2.0, 210.0, 0.01, 0.3), Mode(1.5, 330.0, 0.02, 1.7, "tool"), Mode(3.0, 520.0, 0.008, 2.6, "tool")])


def random_machine(rng, modes):
    """A structure of so many modes, in any direction, on tool or workpiece, and an engagement."""
    found = [Mode(rng.uniform(0.5, 3.0), rng.uniform(150.0, 900.0), rng.uniform(0.005, 0.03), rng.uniform(-math.pi, math.pi),
                  "tool" if rng.random() < 0.5 else "workpiece") for _ in range(modes)]  # fmt: skip
    cutter = Cutter(int(rng.integers(1, 5)), helix_angle=0.5 if modes % 2 else 0.0)
    side = "down-milling" if rng.random() < 0.5 else "up-milling"
    return Model(Structure.of(found), cutter, Cutting(side, rng.uniform(0.1, 0.5), 6e8, 2e8))


def relative(model, cut, sampling, **more):
    """(x, y) of the workpiece against the tool, shape (2, samples)."""
    found = fast.simulate(model, cut, sampling, channels=[f"{place}displacement_{axis}" for place in ("", "tool_")
                                                          for axis in "xy"], **more).channels  # fmt: skip
    return np.array([found[f"displacement_{axis}"] - found[f"tool_displacement_{axis}"] for axis in "xy"])


def apart(one, other):
    """Largest difference over the peak."""
    return float(np.abs(one - other).max() / np.abs(other).max())


@pytest.mark.parametrize("modes", [1, 2, 3, 4])
def test_random_machines_move_as_by_the_second_road(modes):
    rng = np.random.default_rng(modes)
    model, speed = random_machine(rng, modes), 2.0 * math.pi * rng.uniform(50.0, 120.0)
    cut = Cut(speed, 0.3e-3, passes=5 * model.cutter.flutes)
    sampling = whole_cut_sampling(cut, model.cutter.flutes, RATE)
    road = Road(model, speed, 0.3e-3, cut.feed_per_tooth, 10.0 * math.pi)
    assert apart(relative(model, cut, sampling), road.motion(np.arange(sampling.count) / RATE)) < 1e-6


@pytest.mark.parametrize("modes", [1, 2, 3, 4])
def test_mujoco_agrees_on_random_machines(modes):
    rng = np.random.default_rng(10 + modes)
    model, speed = random_machine(rng, modes), 2.0 * math.pi * rng.uniform(50.0, 120.0)
    cut = Cut(speed, 0.3e-3, idle_passes=1, passes=3 * model.cutter.flutes, ring_down_passes=2, initial_displacement=1e-6)
    sampling = whole_cut_sampling(cut, model.cutter.flutes, RATE)
    ours, theirs = (engine.simulate(model, cut, sampling, channels=tuple(fast.CHANNELS), steps=steps).channels
                    for engine, steps in ((fast, 400), (mujoco_engine, 1600)))  # fmt: skip
    for name in fast.CHANNELS:  # the reference samples accelerations and forces by lower powers within its steps
        least = 1e-8 if "acceleration" not in name and "force" not in name else 1e-6
        assert np.abs(theirs[name] - ours[name]).max() <= least * np.abs(ours[name]).max(), name


def test_the_order_is_four():
    model = Model(MACHINE, Cutter(3, helix_angle=0.4), Cutting(immersion=0.2))
    cut = Cut(2.0 * math.pi * 60.0, 0.5e-3, passes=12)
    states = [fast.simulate_batch([model], [cut], [Sampling(1.0, 1)], steps=steps).pass_states[0] for steps in (40, 80, 640)]
    errors = [apart(one, states[2]) for one in states[:2]]
    assert math.log2(errors[0] / errors[1]) > 3.5, errors


@pytest.mark.parametrize("machine, effects", [(FLEXURE, {}), (MACHINE, {}),
                                              (MACHINE, {"process_damping": {"coefficient": 1e4}})])  # fmt: skip
def test_forces_are_sampled_to_the_order_of_the_motion(machine, effects):
    """What a tooth meets lies between the steps: forces were good to the third order, a thousandth where motion was 1e-5."""
    model = Model(machine, Cutter(2), Cutting("down-milling", 0.25, 1.2e9, 4e8))
    for name, values in effects.items():
        model = model.with_effect(name, **values)
    sampling = Sampling(4000.0, 1000, 0.003)
    found = [predict_cuts([model], [Cut(352.0, 2e-4, idle_passes=2, passes=60)], [sampling], ("force_x", "force_y"),
                          refinement=times, catalogue=catalogue())[0] for times in (1, 2, 16)]  # fmt: skip
    coarse, half = (apart(one, found[2]) for one in found[:2])
    assert coarse < 2e-6 and half < coarse / 10.0


@pytest.mark.parametrize("feature", ["straight", "helix"])
def test_one_mode_on_the_tool_is_the_flexure_seen_from_the_other_side(feature):
    model = Model(FLEXURE, Cutter(3, helix_angle=0.5 if feature == "helix" else 0.0), Cutting())
    cut = Cut(2.0 * math.pi * 60.0, 1e-3, passes=20, idle_passes=3, ring_down_passes=10, initial_displacement=1e-5)
    sampling = whole_cut_sampling(cut, 3, RATE)
    names = (*MOTION_UNITS, "force_x", "force_y", "spindle_angle")
    one = fast.simulate(model, cut, sampling, channels=names).channels
    other = fast.simulate(replace(model, structure=replace(FLEXURE, on="tool")), cut, sampling,
                          channels=tuple(fast.CHANNELS)).channels  # fmt: skip
    for name in MOTION_UNITS:
        assert apart(-other[f"tool_{name}_x"], one[name]) < 1e-12
        assert not other[name].any() and not other[f"{name}_y"].any() and not other[f"tool_{name}_y"].any()
    assert all(apart(other[name], one[name]) < 1e-12 for name in names[3:])
    still = fast.simulate(model, cut, sampling, channels=tuple(fast.CHANNELS)).channels
    assert np.array_equal(still["displacement_x"], one["displacement"]) and not still["displacement_y"].any()


def test_equal_modes_turned_together_move_the_same():
    """Two equal modes at right angles have no direction of their own."""
    cut = Cut(2.0 * math.pi * 80.0, 0.4e-3, passes=20, ring_down_passes=4)
    sampling = whole_cut_sampling(cut, 2, RATE)
    found = [relative(Model(Structure.of([Mode(1.0, 400.0, 0.02, turn), Mode(1.0, 400.0, 0.02, turn + math.pi / 2)]),
                            Cutter(2), Cutting("down-milling")), cut, sampling) for turn in (0.0, 0.7, 2.0)]  # fmt: skip
    assert np.abs(found[0]).max() > 1e-7
    assert apart(found[1], found[0]) < 1e-11 and apart(found[2], found[0]) < 1e-11


def test_a_second_mode_with_a_direction_is_a_further_mode_of_the_structure():
    effect = {"mass_ratio": 0.5, "frequency": 300.0, "damping_ratio": 0.01, "participation": 1.0}
    cut = Cut(2.0 * math.pi * 60.0, 0.5e-3, passes=20, ring_down_passes=10)
    sampling = whole_cut_sampling(cut, 1, RATE)
    for direction in (0.0, 1.0):
        one = Model(FLEXURE, Cutter(), Cutting()).with_effect("second_mode", **effect, direction=direction)
        other = Model(replace(FLEXURE, further=(Mode(FLEXURE.mass / 0.5, 300.0, 0.01, direction),)), Cutter(), Cutting())
        assert apart(relative(one, cut, sampling, steps=80), relative(other, cut, sampling, steps=80)) < 1e-9
    assert not catalogue()["second_mode"].acts_across(effect | {"direction": 0.0})


def test_a_free_machine_loses_energy_as_its_damping_says():
    """What every mode's damper takes up makes up for what kinetic and elastic energy lose."""
    cut = Cut(2.0 * math.pi * 10.0, 0.0, passes=0, ring_down_passes=20, initial_displacement=5e-5, initial_velocity=0.02)
    sampling = whole_cut_sampling(cut, 1, 40000.0)
    for mode in (Mode(2.0, 210.0, 0.01, 0.3), Mode(1.5, 330.0, 0.02, 1.7, "tool")):
        model = Model(Structure.of([mode, Mode(3.0, 520.0, 0.008, 2.6)]), Cutter(), Cutting())
        sensor = "tool_" if mode.on == "tool" else ""
        names = [f"{sensor}{quantity}_{axis}" for axis in "xy" for quantity in ("displacement", "velocity")]
        found = fast.simulate(model, cut, sampling, channels=names).channels
        place, rate = (np.hypot(found[f"{sensor}{quantity}_x"], found[f"{sensor}{quantity}_y"])
                       for quantity in ("displacement", "velocity"))  # fmt: skip
        energy = 0.5 * mode.mass * rate**2 + 0.5 * mode.stiffness * place**2
        lost = np.concatenate([[0.0], np.cumsum(mode.damping * 0.5 * (rate[1:] ** 2 + rate[:-1] ** 2)) / sampling.rate])
        assert energy[-1] < 0.01 * energy[0]
        assert np.abs(energy + lost - energy[0]).max() < 1e-4 * energy[0]


@pytest.mark.parametrize("spindle, limit", [(5000.0, 0.1271), (10000.0, 0.1810), (15000.0, 0.2818), (20000.0, 0.1762)])
def test_the_motion_grows_above_the_known_limit_and_dies_below_it(spindle, limit):
    """Half immersion, down, the same mode in x and y; the limits (mm) of its delay equation, from two solvers that agree."""
    structure = Structure.of([Mode(0.03993, 922.0, 0.011, direction) for direction in (0.0, math.pi / 2)])
    model = Model(structure, Cutter(2), Cutting("down-milling", 0.25, 6e8, 2e8))
    growth = []
    for depth in (0.97 * limit, 1.03 * limit):
        cut = Cut(spindle * math.pi / 30.0, depth * 1e-3, passes=400)
        states = fast.simulate_batch([model], [cut], [Sampling(1.0, 1)]).pass_states[0]
        moved = np.diff(states, axis=0) * [1.0, 1.0 / (2.0 * math.pi * 922.0)]
        size = np.array([np.abs(part).max() for part in (moved[150:200], moved[350:400])])
        growth.append(math.log(size[1] / size[0]))
    assert growth[0] < -0.05 and growth[1] > 0.05, growth


def test_machines_of_several_kinds_run_side_by_side_as_alone():
    cut = Cut(2.0 * math.pi * 60.0, 0.4e-3, passes=8)
    sampling = whole_cut_sampling(cut, 2, RATE)
    models = [Model(structure, Cutter(2), Cutting()) for structure in (
        MACHINE, FLEXURE, replace(FLEXURE, direction=1.0), replace(MACHINE, further=MACHINE.further[:1]), FLEXURE)]  # fmt: skip
    together = fast.simulate_batch(models, [cut] * 5, [sampling] * 5, general=True, signals=15)
    assert np.ptp(together.out[0, 6]) > 1e-8
    for place, model in enumerate(models):
        alone = fast.simulate_batch([model], [cut], [sampling], general=True, signals=15)
        for name in ("pass_states", "outcome", "pass_times"):
            assert np.array_equal(getattr(together, name)[place], getattr(alone, name)[0])
        rows = [0, *range(6, 15)]  # not the forces, which nobody asked for
        assert np.array_equal(together.out[place, rows], alone.out[0, rows])


def uneven(pitches, helix=0.0, immersion=0.3, direction="up-milling", structure=MACHINE):
    """A machine with teeth of these pitches, deg."""
    cutter = Cutter(len(pitches), helix_angle=helix, pitch_angles=tuple(math.radians(one) for one in pitches))
    return Model(structure, cutter, Cutting(direction, immersion, 6e8, 2e8))


@pytest.mark.parametrize("pitches, helix, immersion, direction", [
    ((170.0, 190.0), 0.0, 0.12, "down-milling"), ((80.0, 100.0, 85.0, 95.0), 0.0, 0.3, "down-milling"),
    ((80.0, 100.0, 85.0, 95.0), 0.5, 0.3, "up-milling"), ((110.0, 125.0, 125.0), 0.4, 0.5, "up-milling")])  # fmt: skip
def test_teeth_of_unequal_pitch_move_the_machine_as_by_the_second_road(pitches, helix, immersion, direction):
    """And at fourth order."""
    model, speed = uneven(pitches, helix, immersion, direction), 2.0 * math.pi * 70.0
    cut = Cut(speed, 0.3e-3, passes=4 * len(pitches) + 1)  # which ends within a revolution
    sampling = whole_cut_sampling(cut, len(pitches), RATE)
    road = Road(model, speed, 0.3e-3, cut.feed_per_tooth, 2.0 * math.pi * cut.passes / len(pitches))
    true = road.motion(np.arange(sampling.count) / RATE)
    assert apart(relative(model, cut, sampling), true) < 1e-6
    errors = [apart(relative(model, cut, sampling, steps=steps), true) for steps in (20, 40)]
    assert errors[1] < 1e-7 and math.log2(errors[0] / errors[1]) > 3.5, errors


def test_forces_on_unequal_teeth_between_the_steps_are_of_fourth_order():
    model = uneven((80.0, 100.0, 85.0, 95.0), helix=0.5)
    cut = Cut(2.0 * math.pi * 70.0, 0.3e-3, passes=24)
    sampling, names = whole_cut_sampling(cut, 4, RATE), ("force_x", "force_y")

    def forces(refinement: int) -> np.ndarray:
        return predict_cuts([model], [cut], [sampling], names, refinement=refinement)[0]

    true = forces(16)
    errors = [float(np.sqrt(np.mean((forces(times) - true) ** 2)) / true.std()) for times in (1, 2)]
    assert errors[0] < 1e-7 and math.log2(errors[0] / errors[1]) > 3.5, errors


def test_a_flight_at_a_speed_that_swings_is_as_exact_however_fast_the_structure_is():
    swings = {"amplitude": 0.01, "frequency": 7.0, "phase": 0.3}
    model = Model(Structure.of([replace(one, natural_frequency=10.0 * one.natural_frequency) for one in MACHINE.modes]),
                  Cutter(2), Cutting()).with_effect("speed_variation", **swings)
    cut = Cut(2.0 * math.pi * 60.0, 0.05e-3, idle_passes=8, passes=6, ring_down_passes=20, initial_displacement=1e-5)
    sampling = whole_cut_sampling(cut, 2, RATE)
    found, true = (predict_cuts([model], [cut], [sampling], ("displacement",), refinement=times)[0] for times in (1, 8))
    assert apart(found, true) < 1e-6


def test_unequal_teeth_are_simulated_beside_equal_ones():
    cut = Cut(2.0 * math.pi * 60.0, 0.4e-3, passes=8)
    sampling = whole_cut_sampling(cut, 2, RATE)
    models = [replace(uneven((170.0, 190.0)), structure=FLEXURE), Model(FLEXURE, Cutter(2), Cutting()), uneven((170.0, 190.0))]
    together = fast.simulate_batch(models, [cut] * 3, [sampling] * 3, signals=15)
    for place, model in enumerate(models):
        alone = fast.simulate_batch([model], [cut], [sampling], signals=15, general=True)
        assert np.array_equal(together.pass_states[place], alone.pass_states[0])
    assert apart(together.pass_states[0], together.pass_states[1]) > 0.01
    with pytest.raises(InputProblem, match="pitch"):
        mujoco_engine.simulate(models[0], cut, sampling)


@pytest.mark.parametrize("modes", [1, 2, 3, 4])
@pytest.mark.parametrize("effects", [(), ("edge_force", "runout", "contact_loss"), ("process_damping", "entry_ramp"),
                                     ("chip_force_exponent", "tool_wear", "helix")])
def test_the_lean_kernels_give_what_the_general_one_gives(modes, effects):
    """Whatever a record begins with, whatever channels are asked for: of base models, and of effects at the edges."""
    rng, known = np.random.default_rng([77, modes]), catalogue()
    hidden = {name: known[name].example() for name in effects}
    for number in range(5):
        model = replace(random_machine(rng, modes), effects=hidden)
        cut = Cut(rng.uniform(200.0, 900.0), rng.uniform(0.05e-3, 0.4e-3), idle_passes=int(rng.integers(1, 6)), passes=14,
                  ring_down_passes=6, late_entry=0.3 * (number % 2), early_exit=0.2, initial_displacement=1e-5,
                  initial_velocity=2e-3, swung_front=number == 2, held_until=0.002 * (number == 3),
                  states=(("modes[1].velocity", 1e-2),) if modes > 1 else ())  # fmt: skip
        sampling = Sampling(float(rng.choice([2000.0, 10000.0])), 900, 0.001)
        names = [f"{place}{quantity}_{axis}" for place in ("", "tool_") for quantity in MOTION_UNITS for axis in "xy"]
        forces = [[], [], ["force_x"], ["force_y"], ["force_x", "force_y"]][number]
        asked = [fast.CHANNELS[name] for name in rng.permutation([*rng.permutation(names)[: 3 + number], *forces])]
        lean = fast.simulate_batch([model], [cut], [sampling], signals=15, asked=asked, forces=bool(forces))
        whole = fast.simulate_batch([model], [cut], [sampling], signals=15, general=True, forces=bool(forces))
        true = whole.out[0, asked]
        assert np.array_equal(np.isnan(lean.out[0]), np.isnan(true)) and np.isfinite(true).any()
        size = np.nanmax(np.abs(whole.out[0, [0, 6, 9, 12]])) * (2000.0 * math.pi) ** (np.array(asked) % 3)[:, None]
        for row in (row for row, one in enumerate(asked) if one in (fast.CHANNELS["force_x"], fast.CHANNELS["force_y"])):
            size[row] = np.nanmax(np.abs(true[row]))
        assert np.nanmax(np.abs(lean.out[0] - true) / size) < 1e-9
        assert apart(lean.pass_states[0], whole.pass_states[0]) < 1e-11
        assert np.allclose(lean.pass_times, whole.pass_times, 1e-13)


def test_which_kernel_serves_depends_on_nothing_but_the_run():
    """An effect at the edges, one of the structure, none, and teeth of unequal pitch: each as it is alone, to the bit."""
    cut = Cut(2.0 * math.pi * 60.0, 0.4e-3, passes=8)
    sampling, known = whole_cut_sampling(cut, 2, RATE), catalogue()
    hidden = [{}, *({name: known[name].example()} for name in ("edge_force", "cubic_stiffness"))]
    models = [Model(MACHINE, Cutter(2), Cutting(), effects=effects) for effects in hidden] + [uneven((170.0, 190.0))]
    together = fast.simulate_batch(models, [cut] * 4, [sampling] * 4, signals=15, asked=[0, 6])
    for place in (1, 2, 3):
        alone = fast.simulate_batch([models[place]], [cut], [sampling], signals=15, asked=[0, 6])
        assert np.array_equal(together.out[place], alone.out[0])
    pair = fast.simulate_batch(models[:2], [cut] * 2, [sampling] * 2, signals=15, asked=[0, 6])
    assert np.array_equal(pair.out, together.out[:2])


def test_a_base_model_that_diverges_is_told_so_by_its_kernel():
    model = Model(MACHINE, Cutter(2), Cutting("down-milling", 0.5, 6e9, 2e9))
    cut = Cut(500.0, 20e-3, passes=400)
    lean, whole = (fast.simulate_batch([model], [cut], [Sampling(1000.0, 200)], signals=15, general=general)
                   for general in (False, True))  # fmt: skip
    assert lean.outcome[0] == whole.outcome[0] == 1 and np.isnan(lean.out[0, :, -1]).all()
    assert np.isnan(lean.pass_states[0]).any() and np.array_equal(np.isnan(lean.pass_states), np.isnan(whole.pass_states))
