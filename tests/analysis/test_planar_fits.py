"""Machines in x and y in a fit: what records become, where a fit starts, what is told, and a machine identified."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.fit.first_state import begun_as_seen
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.held_guesses import with_guesses_held
from testbed.analysis.fit.identifiable import identifiable_parameters
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.modes_start import modes_start
from testbed.analysis.fit.moves import prior_structure, quiet_records
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.prediction import from_first_tooth, predict
from testbed.analysis.fit.solve import Goal
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.linear.planar_multipliers import cut_multipliers
from testbed.catalogue import catalogue
from testbed.cut import Cut, Sampling
from testbed.engines import fast
from testbed.engines import predict as engine
from testbed.files.campaign import Record
from testbed.files.model_file import model_from_text
from testbed.machine import Cutter, Cutting, Mode, Model, Structure, base_parameter
from testbed.recording import Recording, quantity_of, sensor_of
from tests.support import road_simulator
from tests.support.planar_campaign import PLACES, planar_campaign, write_planar
from tests.support.plane_road import Road
from tests.support.shell import Shell

KNOWN = catalogue()
ENGINE = SimpleNamespace(predict_cuts=engine.predict_cuts, predict_driven=engine.predict_driven)
TWO = Model(Structure.of((Mode(2.5, 146.6, 0.01, math.radians(12)), Mode(0.6, 310.0, 0.02, math.radians(100), "tool"))),
            Cutter(2, 20e-3), Cutting("down-milling", 0.2, 6e8, 2e8))
FORCES = (("force_x", "workpiece"), ("force_y", "workpiece"))
RATE = 6400.0
SHAPES = {"displacement": (0, 0), "displacement_y": (0, 1), "tool_displacement_x": (1, 0), "tool_acceleration_y": (1, 1)}


def modes_of(model):
    """(mass, omega, zeta, unit vector) of each mode, written anew."""
    return [(one.mass, 2 * math.pi * one.natural_frequency, one.damping_ratio,
             np.array([math.cos(one.direction), math.sin(one.direction)])) for one in model.structure.modes]


def decaying(model, states, time, channel):
    """What a sensor gives of the free decay from states (q, q') of the modes: closed form."""
    place, axis = SHAPES[channel]
    total = np.zeros(len(time), dtype=complex)
    for number, ((_, omega, zeta, shape), (q, v)) in enumerate(zip(modes_of(model), states, strict=True)):
        if number == place:  # mode 0 is the workpiece's, mode 1 the tool's, which moves against the sum
            root = omega * complex(-zeta, math.sqrt(1 - zeta**2))
            size = complex(q, (root.real * q - v) / root.imag)
            rates = root**2 if "acceleration" in channel else 1.0
            total += (-1.0 if place else 1.0) * shape[axis] * size * np.exp(root * time) * rates
    return total.real


def bare(channels, data, kind="ring-down", **more):
    """A record ready for a fit, of nothing but samples."""
    count = data.shape[1]
    return Observed("one", kind, channels, data, RATE, 0.0, np.full(len(channels), 1e-9), "idle", np.zeros((count, 0)), (),
                    (kind,), modes=2, **more)


def test_channels_go_by_what_their_sensors_sit_on():
    assert sensor_of("tool_acceleration_y") == ("tool", 1, 2) and sensor_of("displacement") == ("workpiece", 0, 0)
    assert sensor_of("force_y") is None and quantity_of("tool_velocity_x") == "velocity"
    channels = {name: np.arange(3.0) + number for number, name in
                enumerate(("displacement_x", "displacement_x_2", "acceleration_y", "force_y", "displacement_x_3"))}
    seen = Recording(channels, 1e3, dict.fromkeys(channels, "m"), "measured", on_tool=("displacement_x_2",)).in_the_plane()
    assert list(seen.channels) == ["displacement", "tool_displacement_x", "acceleration_y", "force_y"]
    assert seen.channels["tool_displacement_x"][0] == 1.0 and seen.channels["displacement"][0] == 0.0


def test_every_mode_of_a_free_decay_begins_with_a_state_of_its_own():
    states, time = ((3e-5, 0.01), (-2e-5, 0.03)), np.arange(400) / RATE
    record = bare(tuple(SHAPES), np.zeros((4, 400)), force=np.zeros(400))
    own = Nuisances(*states[0], states=(("modes[1].displacement", states[1][0]), ("modes[1].velocity", states[1][1])))
    found = predict(ENGINE, record, [(TWO, 0.0, own)])[0]
    for row, channel in zip(found, SHAPES, strict=True):
        truth = decaying(TWO, states, time, channel)
        assert np.abs(row - truth).max() < 1e-9 * np.abs(truth).max()
    names = Fitter(ENGINE, [record], []).own_steps(record, own)
    assert [name for step in names for name in step][-2:] == ["modes[1].displacement", "modes[1].velocity"]
    assert record.further_states == (("modes[1].displacement", "modes[1].velocity"),)


def test_a_cut_begins_with_the_states_of_all_modes_and_its_first_samples_show_them():
    states, time = ((3e-5, 0.01), (-2e-5, 0.03)), np.arange(200) / RATE
    cut = Cut(400.0, 1e-4, idle_passes=8, passes=4, initial_displacement=states[0][0], initial_velocity=states[0][1],
              held_until=0.01, states=(("modes[1].displacement", states[1][0]), ("modes[1].velocity", states[1][1])))
    channels = tuple(SHAPES)
    found = engine.predict_cuts([TWO], [cut], [Sampling(RATE, 200, 0.01)], channels)[0]
    free = time < 0.01
    for row, channel in zip(found, channels, strict=True):
        truth = decaying(TWO, states, time, channel)
        assert np.abs(row - truth)[free].max() < 1e-8 * np.abs(truth).max()
    data = np.array([decaying(TWO, states, time, channel) for channel in channels])
    seen = begun_as_seen(replace(bare(channels, data, "cut"), noise=1e-3 * data.std(axis=1)), Nuisances(), TWO.structure)
    for value, truth in ((seen.displacement, states[0][0]), (dict(seen.states)["modes[1].velocity"], states[1][1])):
        assert value == pytest.approx(truth, rel=0.2)  # to begin a fit with: damping is not asked for


def test_frequencies_and_dampings_of_all_modes_begin_as_free_decays_show_them():
    time, channels = np.arange(4000) / RATE, ("displacement", "tool_displacement_x")
    clean = np.array([decaying(TWO, ((3e-5, 0.0), (2e-5, 0.0)), time, channel) for channel in channels])
    noisy = clean + 1e-7 * np.random.default_rng(1).standard_normal(clean.shape)
    off = {"modes[0].natural_frequency": 149.5, "modes[1].natural_frequency": 304.0, "modes[0].damping_ratio": 0.014}
    recording = Recording({"displacement_x": noisy[0], "displacement_x_2": noisy[1]}, RATE,
                          {"displacement_x": "m", "displacement_x_2": "m"}, "measured", on_tool=("displacement_x_2",))
    believed, record = replace(TWO, cutter=None, cutting=None).with_values(off), Record("tap", "ring-down", recording)
    begun = modes_start([observe(record, TWO)], believed)
    fitter, fit = model_fit(ENGINE, [observe(record, believed)], believed, KNOWN)
    assert [one.path for one in fitter.free] == [f"modes[{place}].{name}" for place in (0, 1)
                                                 for name in ("natural_frequency", "damping_ratio")]
    for found in (begun, fit.state.model):  # x alone tells no direction, and no mass
        for mode, truth in zip(found.structure.modes, TWO.structure.modes, strict=True):
            assert mode.natural_frequency == pytest.approx(truth.natural_frequency, rel=1e-4)
            assert mode.damping_ratio == pytest.approx(truth.damping_ratio, rel=0.02)


@pytest.mark.parametrize(("on", "place"), [("workpiece", 0), ("tool", 1)])
def test_a_measured_force_drives_the_part_it_acts_on_along_its_axis(on, place):
    """The steady answer to a sinusoid along y, by the receptance of that part's mode."""
    time, omega = np.arange(6400) / RATE, 2 * math.pi * 200.0
    force, name = 5.0 * np.cos(omega * time), "displacement_y" if on == "workpiece" else "displacement_y_2"
    recording = Recording({"force_y": force, name: 1e-6 * np.cos(omega * time)}, RATE, {"force_y": "N", name: "m"}, "measured",
                          on_tool=() if on == "workpiece" else (name,))
    record = observe(Record("driven", "excited", recording), TWO)
    assert record.pushed == (on, (0.0, 1.0))
    record = replace(record, force=force)
    found = predict(ENGINE, record, [(TWO, 0.0, Nuisances())])[0, 0]
    mass, own, zeta, shape = modes_of(TWO)[place]
    answer = shape[1] ** 2 / mass / (own**2 - omega**2 + 2j * zeta * own * omega)  # where it is pushed it moves with the force
    truth = (5.0 * answer * np.exp(1j * omega * time)).real
    assert np.abs(found - truth)[5900:].max() < 1e-3 * np.abs(truth).max()  # its own vibration has died away by then


def test_what_the_channels_do_not_tell_is_named_and_what_would_tell_it():
    tests = ((3800, 0.5e-3), (4500, 0.6e-3))

    def told(places, model=TWO):
        records = planar_campaign(fast.simulate, model, tests, places, course=(5, 12, 6), rate=RATE)
        records = [observe(one, model) for one in records]
        return identifiable_parameters(ENGINE, records, model, KNOWN)

    motion = told((PLACES[0], PLACES[1], PLACES[2], PLACES[3]))
    (mass,) = motion.held
    assert mass.path == "modes[0].mass" and mass.helps == ("the cutting force",)
    assert set(mass.entangled) == {"modes[1].mass", "tangential_coefficient", "normal_coefficient"}
    assert motion.notes[0].startswith("these channels cannot tell modes[0].mass from ")
    assert "to tell it, measure the cutting force" in motion.notes[0]
    assert "modes[0].mass" not in {one.path for one in motion.free} and len(motion.free) == 9
    assert told((*PLACES, *FORCES)).held == ()
    quiet = replace(TWO, structure=Structure.of((TWO.structure.modes[0], replace(TWO.structure.modes[1], mass=600.0))))
    unseen = {one.path: one.helps for one in told(PLACES[:2], quiet).held}  # a mode as stiff as that moves nothing
    assert {"modes[1].mass", "modes[1].natural_frequency", "modes[1].damping_ratio", "modes[1].direction"} <= set(unseen)
    forces = told(FORCES)
    assert forces.held == () and [one.path for one in forces.free] == ["tangential_coefficient", "normal_coefficient"]


def test_a_belief_that_chatters_where_the_machine_did_not_seems_to_tell_no_more():
    """Where what grows without end passes the largest residual that counts, slopes are of that edge, and would tell a mass."""
    tests = ((3800, 0.5e-3), (4500, 0.6e-3))
    believed = TWO.with_values({path: 5.0 * TWO.value(path) for path in ("tangential_coefficient", "normal_coefficient")})
    values, _, _ = cut_multipliers(believed, Cut(3800 * 2 * math.pi / 60, 0.5e-3), 1e-6)
    assert abs(values[0]) > 1.05
    records = [observe(one, believed) for one in
               planar_campaign(fast.simulate, TWO, tests, PLACES, course=(5, 40, 6), rate=RATE)]
    told = identifiable_parameters(ENGINE, records, believed, KNOWN, helps=False)
    assert [one.path for one in told.held] == ["modes[0].mass"]


def test_a_fit_whose_mode_strayed_begins_again_from_the_modes_as_believed():
    believed = TWO.with_values({"modes[1].natural_frequency": 301.0, "tangential_coefficient": 7e8})
    records = [observe(one, believed) for one in planar_campaign(fast.simulate, TWO, ((3800, 0.5e-3), (4500, 0.6e-3)), PLACES,
                                                                course=(5, 12, 6), rate=RATE)]  # fmt: skip
    fitter, found = model_fit(ENGINE, records, believed, KNOWN)
    goal = Goal((), believed, records=tuple(records))
    assert list(prior_structure.propose(fitter, found, goal)) == []
    lost = fitter.fit(found.state.with_value("modes[1].natural_frequency", 180.0), iterations=2)
    assert lost.cost > 2.0 * found.cost
    (trial,) = prior_structure.propose(fitter, lost, goal)
    assert trial.fit.cost == pytest.approx(found.cost, rel=1e-3)
    assert trial.fit.state.model.value("modes[1].natural_frequency") == pytest.approx(310.0, rel=1e-3)


def test_where_all_cuts_lead_astray_the_shallow_ones_are_fitted_first():
    believed = TWO.with_values({"modes[1].natural_frequency": 301.0, "tangential_coefficient": 7e8})
    tests = ((3800, 0.2e-3), (4500, 0.6e-3))
    made = planar_campaign(fast.simulate, TWO, tests, PLACES, course=(5, 12, 6), rate=RATE)
    records = [observe(one, believed) for one in made]
    fitter, found = model_fit(ENGINE, records, believed, KNOWN)
    goal = Goal((), believed, records=tuple(records))
    assert list(quiet_records.propose(fitter, found, goal)) == []
    lost = fitter.fit(found.state.with_value("modes[1].natural_frequency", 180.0), iterations=2)
    assert lost.mean_squares.max() > quiet_records.ASTRAY
    (trial,) = quiet_records.propose(fitter, lost, goal)
    assert trial.fit.cost == pytest.approx(found.cost, rel=1e-3)
    alike = fitter.of_records([1])
    assert list(quiet_records.propose(alike, alike.fit(lost.state.of_records([1]), iterations=0), goal)) == []


def test_a_machine_that_a_second_road_moved_is_found_from_its_files(capsys, tmp_path, monkeypatch):
    """Two cuts; the marks, the noise and the records' beginnings are unknown to the fit."""
    monkeypatch.chdir(tmp_path)
    testbed, tests = Shell(capsys), ((3800, 0.5e-3), (4500, 0.6e-3))
    off = {"natural_frequency": 1.015, "damping_ratio": 1.2, "tangential_coefficient": 1.25, "normal_coefficient": 0.8}
    believed = TWO.with_values({path: TWO.value(path) * off.get(base_parameter(path), 1.0) for path in TWO.base_parameters})
    believed = believed.with_values({"modes[0].direction": math.radians(4), "modes[1].direction": math.radians(108)})
    records = planar_campaign(road_simulator.simulate, TWO, tests, PLACES, course=(5, 15, 8), rate=RATE)
    write_planar(tmp_path, records, believed)
    testbed.refused("identify", "campaign.yaml", "-m", "model.yaml", "--method", "multipliers")
    assert "error: model.yaml: has modes beyond one of the workpiece along x" in testbed.err
    found = testbed.json("identify", "campaign.yaml", "-m", "model.yaml", "-o", "found.yaml")
    assert found["method"] == "waveform" and found["converged"] and found["chi_square"] < 1.2  # the noise of five idle turns
    near = {"natural_frequency": 1e-3, "damping_ratio": 0.05, "mass": 0.05, "tangential_coefficient": 0.02,
            "normal_coefficient": 0.05}
    assert list(found["parameters"]) == [path for path in TWO.base_parameters if path != "immersion"]
    for path, one in found["parameters"].items():
        truth, name = TWO.value(path), base_parameter(path)
        if name == "direction":
            assert abs(one["value"] - truth) < math.radians(3), path
        else:
            assert one["value"] == pytest.approx(truth, rel=near[name]), path
    guesses = [path for path, one in found["parameters"].items() if not one["determined"]]
    assert guesses == ["modes[0].mass"] and found["parameters"][guesses[0]]["low"] is None and found["at_bound"] == []
    assert found["notes"][0].startswith("these channels cannot tell modes[0].mass from") and found["notes"][0] in testbed.err
    multipliers, _, _ = cut_multipliers(TWO, Cut(found["tests"][1]["spindle_speed"], 0.6e-3), 1e-6)
    first = complex(*found["tests"][1]["model"][0])
    assert min(abs(first - multipliers[0]), abs(first - multipliers[0].conjugate())) < 0.02
    assert found["tests"][1]["per"] == "tooth" and found["tests"][1]["measured"] == []
    again = model_from_text(Path("found.yaml").read_text(encoding="utf-8"))
    assert again.not_determined == ("modes[0].mass",)
    assert again.value("modes[1].direction") == pytest.approx(found["parameters"]["modes[1].direction"]["value"], rel=1e-12)


def test_an_interval_holds_what_a_wrong_belief_that_is_held_makes_of_it():
    """A cut so faint that it tells one coefficient alone: the other is held, 30 % off, and bends it."""
    model = Model(Structure.of(TWO.structure.modes[:1]), TWO.cutter, TWO.cutting)
    believed = model.with_values({"tangential_coefficient": 7.8e8, "normal_coefficient": 1.4e8})
    tests = ((3800, 0.04e-3), (4500, 0.04e-3))
    records = planar_campaign(fast.simulate, model, tests, PLACES[:2], course=(5, 15, 8), rate=RATE)
    observed = [observe(record, believed) for record in records]
    held = with_guesses_held(*model_fit(ENGINE, observed, believed, KNOWN), believed, KNOWN)
    both = ("tangential_coefficient", "normal_coefficient")
    (other,) = [path for path in both if not held.values[path].determined]
    (told,) = [path for path in both if path != other]
    one = held.values[told]
    assert one.low < model.value(told) < one.high and one.high - one.low > 0.05 * model.value(told)


def test_of_unequal_teeth_any_may_cut_first():
    """A second road begins with tooth 1; the fit's model counts teeth from the mark, and turns them."""
    pitches = tuple(math.radians(angle) for angle in (110.0, 130.0, 120.0))
    model = replace(TWO, cutter=replace(TWO.cutter, flutes=3, pitch_angles=pitches))
    speed, depth, feed = 400.0, 3e-4, 1e-4
    turned, late = from_first_tooth(model, Nuisances(entry=4))
    assert turned.cutter.pitch_angles == pytest.approx((pitches[1], pitches[2], pitches[0]))
    assert late == pytest.approx((pitches[1] - 2 * math.pi / 3) / (2 * math.pi / 3))
    record = bare(("displacement", "displacement_y"), np.zeros((2, 300)), "cut", cut=Cut(speed, depth, feed), flutes=3,
                  period=2 * math.pi / speed, first_mark=0.0)
    own = Nuisances(entry=4, exit=30)
    found = predict(ENGINE, record, [(model, 0.0, own)])[0]
    begun = (2 * math.pi + pitches[1]) / speed  # tooth 1, a turn after the mark
    road = Road(turned, speed, depth, feed, 8.0)
    time = np.arange(300) / RATE
    shown = (time > begun) & (time < begun + 7.9 / speed)
    first = Model(Structure.of(TWO.structure.modes[:1]), model.cutter, model.cutting)
    assert shown.sum() > 50 and first.structure.planar
    moved = np.array([road.state(one - begun)[0] for one in time[shown]])  # the workpiece's mode alone
    truth = np.outer(TWO.structure.modes[0].shape, moved)
    assert np.abs(found[:, shown] - truth).max() < 1e-4 * np.abs(truth).max()
    state = State(model, 0.0, (own,))
    assert state.share_in_arc(record) < 1.0
