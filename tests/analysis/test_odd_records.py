"""Records as campaigns of real machines hold them: accelerometers, forces beside motions, rounding converters, many pulses."""

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.comparison.adequacy import adequacy_tests, controlled
from testbed.analysis.fit.drift import drift_basis
from testbed.analysis.fit.fit_state import FreeParameter, State
from testbed.analysis.fit.held_out import RecordError, pooled, pooled_doubt
from testbed.analysis.fit.nuisances import Nuisances
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.starts import base_fit
from testbed.analysis.fit.structure_start import decay_start
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.multipliers.recorded_cut import at_measured_speed
from testbed.analysis.search.diagnose import diagnose
from testbed.catalogue import catalogue
from testbed.engines import fast, predict
from testbed.files.campaign import Record
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.recording import CHANNEL_UNITS, Recording
from tests.support.campaign_files import BELIEVED
from tests.support.synthetic_campaign import synthetic_campaign

TRUE = Model(Structure(2.573, 146.42, 0.0032), Cutter(), Cutting())
ENGINE = SimpleNamespace(predict_cuts=partial(predict.predict_cuts, catalogue=catalogue()),
                        predict_driven=partial(predict.predict_driven, catalogue=catalogue()))
RATE = 12800.0


def ring_down(model, channel, noise, *, seed=0, displacement=60e-6, samples=3000):
    clean = ENGINE.predict_driven([model], [(displacement, 0.0)], np.zeros(samples), RATE, (channel,))[0, 0]
    measured = clean + noise * np.random.default_rng(seed).standard_normal(samples)
    return Record(f"{channel}_{seed}", "ring-down", Recording({channel: measured}, RATE, {channel: CHANNEL_UNITS[channel]},
                                                              "measured"), {})


@pytest.mark.parametrize(("channel", "noise"), (("displacement", 5e-7), ("velocity", 5e-4), ("acceleration", 0.5)))
def test_whatever_measures_the_motion_a_nonlinear_decay_is_fitted_down_to_its_noise(channel, noise):
    model = TRUE.with_effect("cubic_stiffness", coefficient=4e13)
    record = observe(ring_down(model, channel, noise), model)
    fit = Fitter(ENGINE, [record], []).fit(State(model, 0.0, (Nuisances(displacement=58e-6, velocity=1e-4),)), iterations=25)
    assert fit.converged
    assert math.sqrt(fit.variance) == pytest.approx(1.0, abs=0.05)


def test_two_decays_of_different_modes_start_at_the_one_that_is_believed_in():
    other = TRUE.with_values({"natural_frequency": 170.0})
    records = [observe(ring_down(model, "displacement", 5e-7), model) for model in (TRUE, other)]
    for believed in (150.0, 168.0):
        started = decay_start(records, TRUE.with_values({"natural_frequency": believed}))
        expected = 146.42 if believed == 150.0 else 170.0
        assert started.structure.natural_frequency == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("channel", "noise"), (("displacement", 1e-7), ("velocity", 1e-4), ("acceleration", 0.1)))
@pytest.mark.parametrize("lasts", (0.1, 0.35))
def test_a_free_decay_is_predicted_from_where_nothing_pushes_any_more(channel, noise, lasts):
    """While a blow lasts, for a share of a period, the acceleration has its largest swing, but the displacement has not."""
    period, count = 1.0 / TRUE.structure.natural_frequency, 6000
    blow = (np.arange(count) / RATE - 0.1) / (lasts * period)
    force = np.where((blow > 0) & (blow < 1), 400 * np.sin(math.pi * blow), 0.0)
    values = ENGINE.predict_driven([TRUE], [(0.0, 0.0)], force, RATE, (channel,))[0, 0]
    values += noise * np.random.default_rng(2).standard_normal(count)
    recording = Recording({channel: values}, RATE, {channel: CHANNEL_UNITS[channel]}, "measured")
    record = observe(Record("tap", "ring-down", recording, {}), TRUE)
    assert force[round(record.start * RATE) + 1 :].max() == 0.0 and record.start < 0.1 + 1.5 * period


@pytest.mark.parametrize("pulses", (2, 60))
def test_a_tachometer_that_shows_another_speed_by_far_is_refused(pulses):
    """More pulses a revolution than written down, or another sampling rate: no fit could follow such a record."""
    record = synthetic_campaign(partial(fast.simulate, steps=37), TRUE, seed=3, tests=((3500, 0.8),))[0]
    marks = record.recording.marks[0] + np.arange(len(record.recording.marks)) * 60 / 3500 / pulses
    wrong = replace(record, recording=replace(record.recording, marks=marks))
    assert observe(record, BELIEVED).period == pytest.approx(60 / 3500, rel=1e-3)
    with pytest.raises(ValueError, match=f"shows {pulses * 3500}.0 rpm where 3500.0 rpm is written down"):
        observe(wrong, BELIEVED)
    with pytest.raises(ValueError, match="written down"):
        at_measured_speed(record.cut(1), wrong.recording, 1)


def test_records_sampled_too_slowly_for_the_structure_can_tell_nothing():
    record = ring_down(TRUE.with_effect("cubic_stiffness", coefficient=4e13), "displacement", 5e-7)
    aliased = replace(record.recording, channels={"displacement": record.recording.channels["displacement"][::50]},
                      sampling_rate=RATE / 50)
    found = diagnose(ENGINE, [observe(replace(record, recording=aliased), TRUE)], TRUE, catalogue())
    assert (found.verdict, found.effects) == ("undecided", ()) and "less than twice in a period" in found.sentence


def row(quantity, error, size, count=1000, noise=0.1):
    return RecordError("", error, noise, np.zeros(count), error**2 * size, size, noise**2 * size, 0.02, quantity)


def test_a_record_in_micrometres_counts_beside_one_in_newtons():
    small, large = row("displacement", 1.0, 1e-10), row("force", 0.1, 1e6)
    error, noise = pooled([small, large])
    assert error == pytest.approx(math.sqrt((1.0**2 + 0.1**2) / 2)) and noise == pytest.approx(0.1)
    assert pooled_doubt([small, large]) == pytest.approx(0.02 / math.sqrt(2))
    assert pooled([row("force", 1.0, 1.0), row("force", 0.1, 9.0)])[0] == pytest.approx(math.sqrt(1.09 / 10))


def test_a_fault_in_the_second_channel_alone_is_no_adequate_model():
    rng = np.random.default_rng(1)
    noise = rng.standard_normal((2, 4000))
    fault = 3.0 * np.sin(np.arange(4000) / 7.0)
    record = Observed("dynamometer", "excited", ("force_x", "force_y"), noise, 1e4, 0.0, np.ones(2), "", drift_basis(4000, 1),
                      (), ())
    clean = RecordError("dynamometer", 1.0, 1.0, noise, 1.0, 1.0, 1.0)
    faulty = replace(clean, residual=noise + [[0.0], [1.0]] * fault)
    assert not any(test.fails for test in controlled(adequacy_tests(record, clean, 0.0, Nuisances())))
    failing = {test.test for test in controlled(adequacy_tests(record, faulty, 0.0, Nuisances())) if test.fails}
    assert failing == {"rms, force_y", "autocorrelation, force_y"}


def test_the_step_of_the_converter_is_noise_even_where_the_idle_stays_within_it():
    (record,) = synthetic_campaign(partial(fast.simulate, steps=37), TRUE, noise=2e-7, tests=((3500, 1.5),),
                                   course=(10, 30, 10))
    coarse = np.round(record.recording.channels["displacement"] / 2e-6) * 2e-6
    rounded = replace(record, recording=replace(record.recording, channels={"displacement": coarse}))
    assert observe(rounded, BELIEVED).noise[0] == pytest.approx(2e-6 / math.sqrt(12), rel=0.2)


def test_with_many_pulses_a_revolution_any_of_them_may_be_the_mark():
    records = []
    for number, record in enumerate(synthetic_campaign(partial(fast.simulate, steps=37), TRUE, course=(6, 30, 10),
                                                       tests=((3500, 1.5), (3810, 2.0), (3050, 1.0)))):
        shift = number % 2 * np.pi / record.conditions["spindle_speed"]
        recording = replace(record.recording, marks=record.recording.marks + shift, pulses_per_revolution=2)
        records.append(observe(replace(record, recording=recording), BELIEVED))
    _, fit = base_fit(ENGINE, records, BELIEVED)
    assert math.sqrt(fit.variance) == pytest.approx(1.0, abs=0.04)
    assert fit.state.model.cutting.tangential_coefficient == pytest.approx(TRUE.cutting.tangential_coefficient, rel=0.03)


def test_a_record_that_idles_amid_loud_ambient_vibration_is_not_taken_to_start_in_the_cut():
    """A pump close to the resonance is as loud as a shallow cut: segments see no idling, the fit finds the entry itself."""
    model = TRUE.with_effect("ambient_vibration", frequency=157.6, amplitude=9e-6, phase=-1.6)
    records = synthetic_campaign(partial(fast.simulate, steps=37), model, seed=3, noise=7e-7,
                                 tests=((3952, 0.6), (4209, 0.9), (4192, 2.3)), course=(14, 40, 20))
    observed = [observe(record, BELIEVED) for record in records]
    early = [record.starts_in_cut for record in observed]
    assert any(early) and not all(early)
    _, fit = base_fit(ENGINE, observed, BELIEVED)
    entries = [nuisances.entry for nuisances in fit.state.nuisances]
    assert max(entries) - min(entries) <= 1


@pytest.mark.parametrize(("believed", "begun", "told"), [(0.0, 0.1, 0.2), (0.0, 0.4, 0.1), (0.5, -0.3, -0.4), (-0.5, 0.4, 0.1)])
def test_of_a_helix_the_size_of_the_whole_angle_counts_and_is_told_with_the_believed_sign(believed, begun, told):
    model = replace(TRUE, cutter=Cutter(helix_angle=believed)).with_effect("helix", angle=begun)
    fitter = Fitter(ENGINE, [], [FreeParameter("helix.angle", 0.1, (-0.8, 0.8))])
    moved = fitter.moved(State(model, 0.0, ()), np.array([-3.0])).model.value("helix.angle")
    assert moved == pytest.approx(told) and (believed + moved) * (believed or 1.0) >= 0.0
    assert abs(believed + moved) == pytest.approx(abs(believed + begun - 0.3))
