"""The search for what a model lacks on machines in x and y: what is asked, what is told, and slips named as such."""

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.estimate import Estimate
from testbed.analysis.fit.effect_start import effect_parameters, origins_of
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.free_parameters import free_parameters
from testbed.analysis.fit.identifiable import identifiable_parameters
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.structure_start import decay_start
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.linear.planar_multipliers import cut_multipliers
from testbed.analysis.search.answer import as_json
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.common_factor import restatements
from testbed.analysis.search.diagnose import diagnose
from testbed.analysis.search.diagnosis import verdict_of
from testbed.analysis.search.homogeneity_check import differing
from testbed.analysis.search.judged import too_slow
from testbed.analysis.search.modes_told import mode_in_words, with_modes_told
from testbed.analysis.search.next_test import next_test
from testbed.analysis.search.planar_slips import planar_slips
from testbed.analysis.search.sign_check import _ways, other_way_note
from testbed.api.identify import _of_what_is_left
from testbed.catalogue import catalogue
from testbed.cut import Cut
from testbed.engines import fast
from testbed.engines import predict as engine
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from tests.support.planar_campaign import PLACES, planar_campaign

KNOWN = catalogue()
ENGINE = SimpleNamespace(predict_cuts=engine.predict_cuts, predict_driven=engine.predict_driven)
TWO = Model(Structure.of((Mode(2.5, 146.6, 0.01, math.radians(12)), Mode(0.6, 310.0, 0.02, math.radians(100), "tool"))),
            Cutter(2, 20e-3), Cutting("down-milling", 0.2, 6e8, 2e8))
UNEVEN = replace(TWO, cutter=Cutter(2, 20e-3, pitch_angles=(math.radians(172), math.radians(188))))
EDGE = {"tangential": 2e4, "normal": 1e4}  # N/m
TESTS = ((3800, 0.3e-3), (3300, 0.2e-3), (4500, 0.3e-3))
BELIEVED = TWO.with_values({"modes[0].natural_frequency": 147.5, "modes[1].natural_frequency": 308.0,
                            "tangential_coefficient": 6.6e8, "modes[1].direction": math.radians(104)})


def observed_of(true, believed, places=PLACES, tests=TESTS):
    records = planar_campaign(partial(fast.simulate, steps=37), true, tests, places, 3, (4, 14, 8), rate=4000.0)
    return [observe(record, believed) for record in records]


@pytest.fixture(scope="module")
def observed():
    return observed_of(TWO, BELIEVED)


@pytest.fixture(scope="module")
def base(observed):
    """The believed model as a candidate, not fitted."""
    fitter = Fitter(ENGINE, observed, identifiable_parameters(ENGINE, observed, BELIEVED, KNOWN, helps=False).free)
    return candidate_of(fitter, fitter.fit(State(BELIEVED, 0.0, tuple(Nuisances(2, 20) for _ in observed)), iterations=1),
                        (), None, 1.0)


def test_free_decays_show_the_small_end_of_every_mode(observed):
    found = decay_start(observed, BELIEVED).structure.modes
    assert [one.natural_frequency for one in found] == pytest.approx([146.6, 310.0], rel=1e-3)
    assert [math.degrees(one.direction) for one in found] == pytest.approx([12.0, 100.0], abs=2.0)  # believed: 104


def test_a_direction_that_no_decay_tells_stays_as_believed(observed):
    row = observed[0].channels.index("displacement")
    alone = [replace(record, data=record.data[[row]], noise=record.noise[[row]], channels=("displacement",))
             for record in observed]
    found, believed = decay_start(alone, BELIEVED).structure.modes, BELIEVED.structure.modes
    assert [one.direction for one in found] == [one.direction for one in believed]
    turned = BELIEVED.with_values({"modes[1].direction": math.radians(-77)})  # the same line, seen from its other end
    assert math.degrees(decay_start(observed, turned).structure.modes[1].direction) == pytest.approx(-80.0, abs=2.0)


def test_candidates_start_from_the_small_end_with_what_is_held_held(observed, base):
    held = base.fitter.without("normal_coefficient")
    _, anchored = origins_of(ENGINE, BELIEVED, held, base.fit, anchored=True)
    ratio = BELIEVED.cutting.normal_coefficient / BELIEVED.cutting.tangential_coefficient
    scanned = anchored.scanned.model.cutting
    assert scanned.normal_coefficient / scanned.tangential_coefficient == pytest.approx(ratio)
    assert anchored.state.model.cutting.normal_coefficient == scanned.normal_coefficient
    assert anchored.state.model.cutting.tangential_coefficient != scanned.tangential_coefficient


def test_the_answer_has_every_parameter_of_every_mode(base):
    told = as_json(verdict_of(base, base, [base], (base,), 0.1, ()), BELIEVED)
    assert {"modes[0].natural_frequency", "modes[1].damping_ratio", "modes[1].direction"} <= set(told["base_parameters"])
    assert told["base_parameters"]["modes[1].natural_frequency"]["before"] == 308.0
    assert told["base_parameters"]["modes[1].direction"]["unit"] == "rad"
    assert told["candidates"][0]["parameters"] == {}  # of effects alone
    assert told["mode"] is None


def test_the_slowest_mode_decides_what_is_sampled_too_slowly(base):
    assert not too_slow(base)
    slow = [replace(record, rate=500.0) for record in base.fitter.records]  # the faster mode alone is beyond half of that
    assert not too_slow(replace(base, fitter=base.fitter.on(slow)))
    slower = [replace(record, rate=200.0) for record in slow]
    assert "sampled less than twice" in too_slow(replace(base, fitter=base.fitter.on(slower)))


def test_a_mode_that_is_another_in_every_record_is_named_by_its_path():
    found = {f"cut_{place}": {"modes[1].natural_frequency": Estimate(value, value - 0.1, value + 0.1, "Hz", True)}
             for place, value in enumerate((300.0, 305.0, 310.0))}
    (one,) = differing(found)
    assert one.path == "modes[1].natural_frequency" and "Hz" in one.sentence


def test_the_pitch_of_a_tooth_is_a_parameter_and_the_last_closes_the_circle():
    three = replace(TWO, cutter=Cutter(3, 20e-3))
    moved = three.with_values({"pitch[0]": 2.0, "pitch[1]": 2.2})
    assert moved.cutter.pitch_angles == pytest.approx((2.0, 2.2, 2 * math.pi - 4.2))
    assert moved.value("pitch[1]") == pytest.approx(2.2) and three.value("pitch[0]") == pytest.approx(2 * math.pi / 3)
    for path in ("pitch[2]", "pitch[7]"):
        with pytest.raises(KeyError):
            three.value(path)


def test_slips_exchange_and_turn_channels_and_change_nothing_else(observed):
    slips = {slip.said(slip.model): slip for slip in planar_slips(observed, TWO)}
    assert len(slips) == len(list(planar_slips(observed, TWO)))  # none is asked twice
    exchanged = next(one for told, one in slips.items() if "motion along x and y" in told).records[0]
    assert set(exchanged.channels) == set(observed[0].channels)
    rows, before = (dict(zip(one.channels, one.data, strict=True)) for one in (exchanged, observed[0]))
    assert np.array_equal(rows["displacement_y"], before["displacement"])
    assert np.array_equal(rows["tool_displacement_x"], before["tool_displacement_y"])
    (parts,) = [one for told, one in slips.items() if "tool and workpiece are exchanged" in told]
    assert parts.records[0].sensors[observed[0].channels.index("displacement")].on == "tool"
    (turned,) = [one for told, one in slips.items() if told == "if displacement_y of the tool counts the other way (scale: -1)"]
    signs = turned.records[0].data[:, 50] / observed[0].data[:, 50]
    assert sorted(signs) == [-1.0, 1.0, 1.0, 1.0] and signs[observed[0].channels.index("tool_displacement_y")] == -1.0
    carried = [one.model.structure.modes for told, one in slips.items() if "carries modes[1]" in told]
    assert [one[1].on for one in carried] == ["workpiece"] and carried[0][0] == TWO.structure.modes[0]
    assert {round(math.degrees(one.model.structure.modes[0].direction)) for told, one in slips.items()
            if told.startswith("if modes[0] moves")} == {72, -48}
    assert any(one.model.cutting.direction == "up-milling" for one in slips.values())


def test_another_number_of_teeth_is_of_equal_pitch(observed):
    flutes = [one for one in restatements(observed, UNEVEN) if one.condition == "flutes"]
    assert flutes and all(not one.model.cutter.pitch_angles for one in flutes)
    assert any(one.model.cutter.pitch_angles for one in restatements(observed, UNEVEN) if one.condition == "feed")


def test_what_is_free_is_asked_without_asking_what_would_help():
    alone = observed_of(TWO, BELIEVED, PLACES[:1], TESTS[:1])
    asked = []

    def predict_cuts(models, cuts, samplings, channels, **more):
        asked.append(tuple(channels))
        return engine.predict_cuts(models, cuts, samplings, channels, **more)

    counted = SimpleNamespace(predict_cuts=predict_cuts, predict_driven=engine.predict_driven)
    told = identifiable_parameters(counted, alone, BELIEVED, KNOWN, helps=False)
    assert set(asked) == {("displacement",)}
    assert told.held and told.free == identifiable_parameters(ENGINE, alone, BELIEVED, KNOWN).free
    assert len(told.free) < len(free_parameters(alone, BELIEVED))


@pytest.mark.long
@pytest.mark.parametrize(("true", "said"), [(TWO, "along x and y are exchanged"),
                                            (UNEVEN, "the pitches of the teeth are not equal but 17")])
def test_a_slip_is_named_as_such_and_no_effect(true, said):
    records = planar_campaign(partial(fast.simulate, steps=37), true, TESTS, PLACES, 3, (4, 14, 8), rate=4000.0)
    if true is TWO:  # its channels under each other's names
        others = ["displacement_y", "displacement_x", "displacement_y_2", "displacement_x_2"]
        names = dict(zip(records[0].recording.channels, others, strict=True))
        records = [replace(one, recording=replace(
            one.recording, channels={names[name]: row for name, row in one.recording.channels.items()},
            units={names[name]: unit for name, unit in one.recording.units.items()},
            on_tool=tuple(names[name] for name in one.recording.on_tool))) for one in records]
    observed = [observe(record, BELIEVED) for record in records]
    found = diagnose(ENGINE, observed, BELIEVED, KNOWN)
    assert (found.verdict, found.effects) == ("unexplained", ()) and said in found.sentence


@pytest.mark.parametrize(("quantity", "marked"), [("displacement", False), ("acceleration", True)])
def test_sensors_on_a_part_that_the_model_holds_still_are_said_to_sit_on_the_other(quantity, marked):
    """Such channels tell nothing of the model: no unknown is shared without a tachometer, and a fit leads cuts anywhere."""
    alone = replace(TWO, structure=Structure.of(TWO.structure.modes[:1]))
    places = [(f"{quantity}_{axis}", "workpiece") for axis in "xy"]
    records = planar_campaign(partial(fast.simulate, steps=37), alone, TESTS[:2], places, 3, (4, 14, 8), rate=4000.0)
    records = [replace(one, recording=replace(one.recording, on_tool=tuple(one.recording.channels),
                                              marks=one.recording.marks if marked else np.empty(0))) for one in records]
    found = diagnose(ENGINE, [observe(record, alone) for record in records], alone, KNOWN)
    assert found.verdict == "unexplained" and "the sensors on tool and workpiece are exchanged" in found.sentence


@pytest.mark.long
def test_a_mode_of_the_tool_that_is_missing_is_found_with_its_frequency_direction_and_carrier():
    third = Mode(1.0, 205.0, 0.015, math.radians(50), "tool")
    true = replace(TWO, structure=Structure.of([*TWO.structure.modes, third]))
    observed = observed_of(true, BELIEVED)
    found = diagnose(ENGINE, observed, BELIEVED, KNOWN)
    assert (found.verdict, found.effects) == ("missing_effect", ("second_mode",)) and "carried by the tool" in found.sentence
    told = as_json(found, BELIEVED)
    assert told["mode"] in found.sentence and "on: tool" in told["mode"]
    assert found.best.delta_bic > 1000
    values = found.best.parameters
    assert values["second_mode.frequency"] == pytest.approx(205.0, rel=2e-3)
    assert math.degrees(values["second_mode.direction"]) == pytest.approx(50.0, abs=3.0)
    assert values["second_mode.mass_ratio"] == pytest.approx(2.5, rel=0.1)



@pytest.mark.parametrize("true", [TWO, UNEVEN])
def test_the_next_test_of_two_explanations_is_a_stable_cut_within_reach(observed, true):
    rivals = true.with_effect("edge_force", **EDGE), true.with_effect("process_damping", coefficient=1e5)
    found = next_test(ENGINE, observed if true is TWO else observed_of(UNEVEN, BELIEVED), *rivals)
    assert found is not None and found.difference > 3.0
    assert 0.8 * 3300 < found.spindle_speed * 30 / math.pi < 1.2 * 4500 and 0 < found.depth_of_cut <= 1.25 * 0.3e-3
    cut = Cut(found.spindle_speed, found.depth_of_cut)
    values, _, passes = cut_multipliers(true, cut)
    assert np.abs(values).max() ** (1 / passes) < 0.95


def test_what_every_record_has_for_itself_stays_free(observed):
    humming = BELIEVED.with_effect("ambient_vibration", **KNOWN["ambient_vibration"].example())
    told = identifiable_parameters(ENGINE, observed[:2], humming, KNOWN, helps=False)
    assert {"ambient_vibration.amplitude", "ambient_vibration.phase"} <= {one.path for one in told.free} and told.held


def test_a_second_mode_is_told_by_what_the_records_show_of_it():
    found = {"frequency": 480.0, "damping_ratio": 0.01, "participation": 1.0, "direction": -math.radians(140)}
    ends = {"second_mode.frequency": (470.0, 490.0), "second_mode.direction": (-2.5, -2.4)}

    def told(found, ends):
        values = {path: Estimate(found[path.partition(".")[2]], *pair, "") for path, pair in ends.items()}
        return mode_in_words("second_mode", found, values)

    assert told(found, ends) == ("second_mode: a mode of 480 Hz that moves along 40 deg (from x towards y), carried by the "
                                 "workpiece.")
    assert "480 Hz in a direction that these records do not show" in told(found, ends | {"second_mode.direction": (-3.1, 1.0)})
    for vague in (told(found, ends | {"second_mode.frequency": (100.0, 900.0)}), told(found, {}),
                  told(found | {"damping_ratio": 0.2}, ends)):
        assert "480" not in vague and "do not show at what frequency" in vague


def test_a_mode_that_moves_far_from_the_believed_direction_is_told(base):
    fit = replace(base.fit, covariance=np.zeros((len(base.fit.names),) * 2))
    found = replace(verdict_of(base, base, [base], (), 0.1, ()), verdict="missing_effect", effects=("edge_force",),
                    best=replace(base, fit=fit))

    def told(degrees):
        return with_modes_told(found, BELIEVED.with_values({"modes[1].direction": math.radians(degrees)}), KNOWN).sentence

    assert "modes[1] moves along 104 deg, not along 10 deg" in told(10) and "modes[0]" not in told(10)
    assert "mend" not in told(104) and "mend" not in told(-76)  # half a turn is the same direction


def test_a_sensor_of_the_tool_tells_the_direction_of_a_second_mode_too(observed):
    paths = {one.path for one in effect_parameters(KNOWN["second_mode"], observed)}
    on_tool = [replace(record, channels=("tool_displacement_x", "tool_displacement_y"), data=record.data[:2])
               for record in observed]
    assert {one.path for one in effect_parameters(KNOWN["second_mode"], on_tool)} == paths
    along_x = [replace(record, channels=("displacement",), data=record.data[:1]) for record in observed]
    assert "second_mode.direction" not in {one.path for one in effect_parameters(KNOWN["second_mode"], along_x)}


def test_what_was_told_before_a_fit_is_not_asked_again_of_the_same_records(observed, monkeypatch):
    told = identifiable_parameters(ENGINE, observed[:1], BELIEVED, KNOWN, helps=False)
    assert told.asked_of(list(observed[:1])) and not told.asked_of(observed[1:2]) and not told.asked_of(observed)
    asked = []

    def spied(*given, **more):
        asked.append(given[1])
        return identifiable_parameters(*given, **more)

    monkeypatch.setattr("testbed.analysis.fit.model_fit.identifiable_parameters", spied)
    monkeypatch.setattr("testbed.analysis.fit.model_fit._fitted", lambda *given: ("fitted", SimpleNamespace(cost=math.inf)))
    for records in (observed[:1], observed[1:2]):
        model_fit(ENGINE, records, BELIEVED, KNOWN, cost_limit=0.0, told=told)
    assert asked == [observed[1:2]]


def test_a_machine_in_x_and_y_is_sent_to_the_diagnosis_which_asks_for_its_slips(observed):
    left = SimpleNamespace(quality={"noise_floor": 0.01, "chi_square": 9.0})
    assert _of_what_is_left(left) == ["the model leaves 3 times the noise. What it lacks may bend its parameters beyond their "
                                      "intervals; testbed diagnose says whether an effect is missing"]
    assert not list(_ways(observed, BELIEVED)) and {one.condition for one in planar_slips(observed, BELIEVED)} >= {"milling"}
    assert other_way_note(ENGINE, observed, BELIEVED, KNOWN, 0.5, 0.01) == []
