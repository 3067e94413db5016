"""The MuJoCo engine: its order, its agreement with the fast engine, its state, its failures."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from testbed import models
from testbed.catalogue import catalogue
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines import fast, mujoco_abi, mujoco_engine
from testbed.machine import Cutter, Cutting, Model

RATE = 12800.0
MODEL = Model(models.machine("flexure").structure(), Cutter(), Cutting())


def cut(rpm: float, depth: float, **course: float) -> Cut:
    return Cut(rpm * 2 * math.pi / 60, depth, **{"idle_passes": 1, "passes": 25, "ring_down_passes": 2,
                                                 "initial_displacement": 1e-5, **course})


STABLE, GROWING = cut(3810, 2.9e-3), cut(3635, 2.0e-3)


def motion(engine, model: Model, course: Cut, steps: int | None, channel: str = "displacement") -> np.ndarray:
    flutes = model.cutter.flutes
    sampling = whole_cut_sampling(course, flutes, RATE)
    recording = engine.simulate(model, course, sampling, channels=(channel,), steps=steps)
    assert recording.outcome == "ok"
    signal = recording.channels[channel]
    assert np.nanmax(recording.pass_times) > 0 and np.all(np.isfinite(recording.pass_times))
    seen = recording.time <= recording.pass_times[-1]  # at a varying speed the run may end before the nominal time
    assert seen.mean() > 0.9 and np.array_equal(np.isfinite(signal), seen)
    assert np.ptp(signal[seen]) > 0
    return signal[seen]


def error(signal: np.ndarray, reference: np.ndarray) -> float:
    return float(np.abs(signal - reference).max() / np.abs(reference).max())


def test_offsets_agree_with_the_live_structures():
    mujoco_abi.check()
    assert mujoco_abi.check.cache_info().currsize == 1  # it came to its end, and was no empty call


@pytest.mark.parametrize("name", ["QPOS", "TIME", "NUMERIC_DATA"])
def test_an_offset_that_is_wrong_is_noticed(name, monkeypatch):
    monkeypatch.setattr(mujoco_abi, name, getattr(mujoco_abi, name) + 8)
    with pytest.raises(RuntimeError, match="lays out its structures"):
        mujoco_abi.check.__wrapped__()


@pytest.mark.parametrize("course", [STABLE, GROWING], ids=["stable", "growing"])
def test_fourth_order_against_the_fast_engine(course):
    """Measured: 4.0 in the stable, 4.1 in the growing cut; 3e-8 of the peak at 120 steps."""
    reference = motion(fast, MODEL, course, 400)
    errors = [error(motion(mujoco_engine, MODEL, course, steps), reference) for steps in (15, 30, 60)]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > 3.5), (errors, orders)


def test_agreement_of_the_two_engines():
    reference = motion(fast, MODEL, STABLE, 800)
    assert error(motion(mujoco_engine, MODEL, STABLE, 480), reference) < 1e-9


@pytest.mark.parametrize("channel", ["velocity", "acceleration", "force_x", "force_y", "spindle_angle"])
def test_every_channel_agrees(channel):
    assert error(motion(mujoco_engine, MODEL, STABLE, 120, channel), motion(fast, MODEL, STABLE, 400, channel)) < 1e-6


@pytest.mark.parametrize("flutes, immersion, direction", [(2, 0.162, "up-milling"), (4, 0.3, "down-milling"),
                                                          (1, 0.5, "up-milling"), (2, 0.5, "down-milling")])
def test_flutes_and_engagements_agree(flutes, immersion, direction):
    model = replace(MODEL, cutter=Cutter(flutes), cutting=Cutting(direction, immersion))
    course = cut(3810 / flutes, 0.5e-3)
    assert error(motion(mujoco_engine, model, course, 240), motion(fast, model, course, 720)) < 1e-5


@pytest.mark.parametrize("effect", list(catalogue()))
def test_every_effect_agrees(effect):
    """Two roads: this engine's stages and surface against the fast engine's.

    Kinks inside steps (friction, contact, the slices of a helical edge entering one by one) cost order.
    """
    model = MODEL.with_effect(effect, **catalogue()[effect].example())
    slices = "helix_angle" in catalogue()[effect].hooks
    bound = 2e-3 if not catalogue()[effect].smooth else 5e-5 if slices else 1e-5
    assert error(motion(mujoco_engine, model, STABLE, 100), motion(fast, model, STABLE, 400)) < bound


def test_the_rigs_own_model_moves_like_the_lean_one():
    """Also with a fitted structure, which the rig's model is given."""
    fitted = replace(MODEL, structure=replace(MODEL.structure, mass=2.6, natural_frequency=147.3, damping_ratio=0.004))
    for model in (MODEL, fitted):
        lean, rig = (motion(mujoco_engine, one, STABLE, 30) for one in (model, replace(model, machine="flexure")))
        assert error(rig, lean) < 1e-12
    assert error(motion(mujoco_engine, fitted, STABLE, 30), motion(mujoco_engine, MODEL, STABLE, 30)) > 1e-3


def test_the_rigs_spindle_turns_with_the_cut():
    run = mujoco_engine.prepare(replace(MODEL, machine="flexure"), STABLE, steps=20)
    run.advance(5)
    assert run.data.joint("spindle_angle").qpos[0] == pytest.approx(10 * math.pi, rel=1e-9)
    assert run.data.joint("feed").qpos[0] == pytest.approx(5 * STABLE.feed_per_tooth, rel=1e-9)


def test_a_saved_run_continues_bit_for_bit():
    """With effects that carry states, and a forward evaluation in between."""
    model = MODEL
    for name, effect in catalogue().items():
        if effect.states:
            model = model.with_effect(name, **effect.example())
    assert model.effects
    whole = mujoco_engine.prepare(model, STABLE, steps=20)
    whole.advance(STABLE.total_passes)
    half = mujoco_engine.prepare(model, STABLE, steps=20)
    half.advance(11)
    mujoco.mj_forward(half.model, half.data)
    resumed = mujoco_engine.prepare(model, STABLE, steps=20)
    mujoco_engine.load_state(resumed, mujoco_engine.save_state(half), 11)
    resumed.advance(STABLE.total_passes)
    rest = slice(11 * whole.steps_per_pass, None)
    assert np.ptp(whole.record[rest, 2]) > 0
    assert np.array_equal(resumed.record[rest], whole.record[rest])
    assert np.array_equal(resumed.data.qpos, whole.data.qpos)


@pytest.mark.parametrize("effect", list(catalogue()))
def test_half_saved_and_resumed_is_the_whole_with_every_effect(effect):
    model = MODEL.with_effect(effect, **catalogue()[effect].example())
    runs = [mujoco_engine.prepare(model, STABLE, steps=12) for _ in range(3)]
    whole, half, resumed = runs
    whole.advance(8)
    half.advance(5)
    mujoco_engine.load_state(resumed, mujoco_engine.save_state(half), 5)
    resumed.advance(3)
    assert np.ptp(whole.record[: 8 * whole.steps_per_pass, 2]) > 0
    assert np.array_equal(resumed.data.qpos, whole.data.qpos) and np.array_equal(resumed.data.qvel, whole.data.qvel)


def test_reset_starts_the_same_run_again():
    run = mujoco_engine.prepare(MODEL, replace(STABLE, initial_displacement=0.0), steps=20)
    run.advance(12)
    first = run.data.qpos.copy()
    mujoco.mj_resetData(run.model, run.data)
    run.done = 0
    run.advance(12)
    assert first[0] != 0.0
    assert np.array_equal(run.data.qpos, first)


def test_a_diverged_run_says_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    course = cut(3635, 8e-3, passes=200)
    sampling = whole_cut_sampling(course, 1, RATE)
    recording = mujoco_engine.simulate(MODEL, course, sampling, steps=20)
    signal = recording.channels["displacement"]
    assert recording.outcome == "diverged"
    seen = recording.time <= recording.outcome_time
    assert 0 < seen.sum() < len(signal)
    assert np.all(np.isfinite(signal[seen])) and np.all(np.isnan(signal[~seen]))
    assert np.abs(signal[seen]).max() > 1e-3
    assert abs(recording.outcome_time - fast.simulate(MODEL, course, sampling).outcome_time) < 0.02
    assert not list(tmp_path.iterdir())  # MuJoCo's own log among them


def test_model_text_stands_alone():
    """The text compiles to a model that cuts, with no address of this process in it."""
    text = mujoco_engine.model_xml(MODEL, STABLE, steps=20)
    compiled = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(compiled)
    data.qpos[0] = STABLE.initial_displacement
    run = mujoco_engine.prepare(MODEL, STABLE, steps=20)
    run.advance(10)
    mujoco.mj_step(compiled, data, nstep=10 * run.steps_per_pass)
    assert data.qpos[0] == run.data.qpos[0] != 0.0


def test_unknown_channel_is_refused():
    with pytest.raises(ValueError, match="displacement"):
        mujoco_engine.simulate(MODEL, STABLE, whole_cut_sampling(STABLE, 1, RATE), channels=("temperature",))
