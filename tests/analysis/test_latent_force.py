"""Is the force that a model lacks found in time, with an honest deviation? The truth comes from another integrator."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import StateSpace, lsim

from testbed.analysis.fit.drift import drift_basis
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.observed import Observed
from testbed.analysis.force.cut_variables import SUBSTEPS, Trajectory, course_of, model_force
from testbed.analysis.force.latent_force import missing_force, prior_of, with_force
from testbed.analysis.force.response import response
from testbed.analysis.force.smoother import Prior, smooth
from testbed.engines import fast, predict
from testbed.machine import Cutter, Model, Structure
from tests.support.plain_cut import COURSE, MARK, TRUE, record

RATE, NOISE = 12800.0, 1e-6
STRUCTURE = Model(Structure(2.573, 146.4, 0.02))


def linear(model, force, state, rate=RATE):
    """Displacement and velocity of the linear oscillator under a sampled force, by scipy."""
    s = model.structure
    a = [[0.0, 1.0], [-s.stiffness / s.mass, -s.damping / s.mass]]
    system = StateSpace(a, [[0.0], [1.0 / s.mass]], np.eye(2), np.zeros((2, 1)))
    return lsim(system, force, np.arange(len(force)) / rate, X0=state)[1].T


def predict_driven(models, states, force, rate, channels):
    rows = []
    for model, state in zip(models, states, strict=True):
        known = dict(zip(("displacement", "velocity"), linear(model, force, state, rate), strict=True))
        rows.append(np.stack([known[name] for name in channels]))
    return np.stack(rows)


ENGINE = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict_driven)


def excited(data, force, name="one"):
    data = np.atleast_2d(data)
    return Observed(
        name,
        "excited",
        ("displacement",),
        data,
        RATE,
        0.0,
        np.array([NOISE]),
        "idle",
        drift_basis(data.shape[1], 1),
        (),
        ("excited", name),
        force=force,
    )


def cut_state(records, model=TRUE):
    """The state of a fit that has every entry and exit right (a mark falls a revolution after the start of a record)."""
    first = COURSE[0] - 1
    return State(model, MARK, tuple(Nuisances(entry=first, exit=first + COURSE[1]) for _ in records))


def test_the_response_is_that_of_the_differential_equation():
    cells = np.random.default_rng(0).standard_normal(400 * SUBSTEPS)
    fine = np.repeat(cells, 50)  # held within a cell, as response() takes it; lsim rounds the steps off
    wanted = linear(STRUCTURE, np.append(fine, fine[-1]), (0.0, 0.0), RATE * SUBSTEPS * 50)
    for kind, truth in zip(("displacement", "velocity"), wanted, strict=True):
        found = response(STRUCTURE, cells, RATE, kind)
        assert np.abs(found - truth[:: 50 * SUBSTEPS]).max() < 5e-3 * np.abs(truth).max()


def test_a_known_missing_force_is_recovered_within_its_deviation():
    random = np.random.default_rng(1)
    time = np.arange(6000) / RATE
    drive = 20.0 * np.sin(2 * np.pi * 40.0 * time)
    missing = 20.0 * np.sin(2 * np.pi * 90.0 * time) * np.exp(-(((time - 0.25) / 0.08) ** 2))
    x, _ = linear(STRUCTURE, drive + missing, (0.0, 0.0))
    one = excited(x + NOISE * random.standard_normal(len(x)), drive)
    found = missing_force(ENGINE, [one], State(STRUCTURE, 0.0, (Nuisances(),)), {}).records[0]
    inner = slice(100, -100)
    error = (found.force - missing)[inner]
    assert np.std(error) < 0.15 * np.std(missing[inner])
    assert 0.4 < np.sqrt(np.mean((error / found.deviation[inner]) ** 2)) < 1.6
    assert np.abs(found.displacement - x).max() < 3.0 * NOISE and np.std(found.displacement - x) < 0.6 * NOISE


def test_a_complete_model_leaves_no_force():
    random = np.random.default_rng(2)
    drive = 20.0 * random.standard_normal(4000)
    x, _ = linear(STRUCTURE, drive, (0.0, 0.0))
    one = excited(x + NOISE * random.standard_normal(len(x)), drive)
    found = missing_force(ENGINE, [one], State(STRUCTURE, 0.0, (Nuisances(),)), {}).records[0]
    assert np.std(found.force) < 0.05 * np.std(drive)
    assert np.abs(found.force).max() < 6.0 * found.deviation.max()


def test_the_smoother_reads_velocity_and_acceleration_too():
    time = np.arange(3000) / RATE
    force = 5.0 * np.sin(2 * np.pi * 60.0 * time)
    x, v = linear(STRUCTURE, force, (0.0, 0.0))
    s = STRUCTURE.structure
    a = (force - s.damping * v - s.stiffness * x) / s.mass
    for name, values in (("velocity", v), ("acceleration", a)):
        noise = 1e-3 * np.std(values)
        noisy = values + noise * np.random.default_rng(3).standard_normal(len(values))
        states, variances = smooth(STRUCTURE, Prior(2, 5.0, 2e-3), noisy[None], [name], np.array([noise]), RATE)
        assert np.std((states[:, 2] - force)[100:-100]) < 0.1 * np.std(force), name
        assert np.all(variances[:, 2] > 0.0)


@pytest.fixture(scope="module")
def square_law():
    """Two cuts with a force by the square of the chip that no model has."""
    law = 2.0e12
    made = [
        record(rpm, 1.5e-3, seed, noise=0.2e-6, tooth_law=lambda depth, chip, angle: law * depth * chip * chip)
        for seed, rpm in enumerate((3500.0, 4200.0))
    ]
    records = [observe(one, TRUE) for one in made]
    return law, missing_force(ENGINE, records, cut_state(records), {})


def test_the_force_in_the_cut_is_that_of_the_hidden_law(square_law):
    law, missing = square_law
    for one in missing.records:
        steady = one.cutting & (one.time > 0.2) & (one.time < 0.5)
        chip = one.chip[steady]
        truth = -law * one.depth * chip**2 * np.sin(one.angle[steady])
        assert np.std(truth) > 3.0
        assert np.std(one.force[steady] - truth) < 0.6 * np.std(truth)  # the smoother rounds the jump at the exit off
        assert np.corrcoef(one.force[steady], truth)[0, 1] > 0.85
        quiet = one.time > one.time[-1] - 0.15
        assert np.std(one.force[quiet]) < 0.3 * np.std(truth)
    force_map = missing.force_map(cutting=True)
    assert len(force_map["force"]) == len(force_map["velocity"]) == sum(one.cutting.sum() for one in missing.records)


def test_a_wrong_base_model_is_taken_off_exactly(square_law):
    """The same records under a wrong model, then told the right one: the same force as with the right one at once."""
    _, right = square_law
    values = {"natural_frequency": 147.0, "damping_ratio": 0.005, "tangential_coefficient": 6.2e8}
    wrong = missing_force(ENGINE, right.observed, cut_state(right.observed, TRUE.with_values(values)), {})
    told = with_force(wrong, cut_state(right.observed))
    for one, other, bad in zip(told.records, right.records, wrong.records, strict=True):
        inside = (other.time > 0.2) & (other.time < 0.5)
        assert np.std((one.force - other.force)[inside]) < 0.15 * np.std(other.force[inside])
        assert np.std((bad.force - other.force)[inside]) > 0.3 * np.std(other.force[inside])


HELICAL = replace(
    TRUE, cutter=Cutter(4, helix_angle=0.4), cutting=replace(TRUE.cutting, direction="down-milling", immersion=0.4)
)


@pytest.mark.parametrize("model", [TRUE, HELICAL], ids=["one straight tooth", "two helical teeth at a time"])
def test_the_model_s_force_along_a_motion_is_the_engine_s(model):
    one = observe(record(3500.0, 0.3e-3, 5, noise=1e-9), model)
    state = State(model, MARK, (Nuisances(entry=4 * COURSE[0], exit=4 * sum(COURSE[:2])),))
    cut, sampling = one.timeline(state.angle, state.nuisances[0])
    names = ("displacement", "velocity", "force_x")
    engine = fast.simulate(model, cut, sampling, channels=names).channels
    course = course_of(one, state, 0, {})
    motion = Trajectory(one.start, one.rate, engine["displacement"], engine["velocity"])
    found = course.sampled(model_force(model, {}, course, motion).along)
    inside = (np.abs(engine["force_x"]) > 0) & (np.abs(found) > 0)
    inside &= np.roll(inside, 1) & np.roll(inside, -1)  # a sample beside a jump averages over it
    assert inside.sum() > 500 and np.std(engine["force_x"][inside]) > 1.0
    apart = np.abs(found - engine["force_x"])[inside]  # a tooth that enters beside another makes a jump, too
    assert np.quantile(apart, 0.9) < 0.01 * np.abs(engine["force_x"]).max()


def test_a_prediction_that_diverged_does_no_harm():
    def diverged(models, states, force, rate, channels):
        return np.full((len(models), len(channels), len(force)), np.nan)

    x, _ = linear(STRUCTURE, np.zeros(3000), (1e-4, 0.0))
    one = replace(excited(x, np.zeros(3000)), kind="ring-down")
    engine = SimpleNamespace(predict_driven=diverged)
    found = missing_force(engine, [one], State(STRUCTURE, 0.0, (Nuisances(),)), {}).records[0]
    assert np.isfinite(found.force).all() and np.abs(found.displacement - x).max() < 1e-5


def test_no_prior_is_tuned_on_a_record_of_a_few_samples():
    short = SimpleNamespace(channels=("displacement",), samples=64, noise=np.array([NOISE]), rate=RATE)
    long = SimpleNamespace(channels=("displacement",), samples=600, noise=np.array([NOISE]), rate=RATE)
    rest = 5e-6 * np.sin(np.arange(600) / 20.0)[None]
    tuned = prior_of(STRUCTURE, [long], [rest])
    assert prior_of(STRUCTURE, [short, long], [rest[:, :64] * 1e3, rest]) == tuned
    assert prior_of(STRUCTURE, [short], [rest[:, :64]]).order == 1
