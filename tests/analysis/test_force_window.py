"""A measured hammer blow: the force's noise outside the blow, its zero, and a response that drifts."""

import numpy as np
from scipy import signal

from testbed.analysis.fit.force_window import windowed
from testbed.analysis.fit.model_fit import model_fit
from testbed.analysis.fit.observe import observe
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.files.campaign import Record
from testbed.machine import Model, Structure
from testbed.recording import Recording

RATE, MASS, FREQUENCY, DAMPING = 20000.0, 0.84, 322.2, 0.0135
TIME = np.arange(30000) / RATE


def blow(strength: float = 150.0, start: float = 0.2, duration: float = 2e-3) -> np.ndarray:
    """A half sine, N."""
    phase = (TIME - start) / duration
    return np.where((phase > 0) & (phase < 1), strength * np.sin(np.pi * phase), 0.0)


def test_outside_a_blow_nothing_is_left_and_the_blow_keeps_its_impulse() -> None:
    measured = blow() + 0.7 + 0.3 * np.random.default_rng(1).standard_normal(TIME.size)
    found = windowed(measured)
    assert np.mean(found != 0.0) < 0.01
    assert not found[:3900].any() and not found[4200:].any()
    assert abs(found.sum() / blow().sum() - 1.0) < 1e-3


def test_two_blows_of_different_strength_are_both_kept() -> None:
    true = blow() + blow(8.0, 0.9)
    found = windowed(true + 0.1 * np.random.default_rng(2).standard_normal(TIME.size))
    assert found[18000:18040].sum() > 0.9 * true[18000:18040].sum()


def test_forces_without_blows_are_as_measured() -> None:
    random = np.random.default_rng(3)
    shaker = random.standard_normal(TIME.size)
    burst = np.where(TIME < 0.5, 40.0 * shaker, 0.01 * shaker)
    for force in (shaker, burst, blow(), np.zeros(TIME.size)):
        np.testing.assert_array_equal(windowed(force), force)


def test_modal_mass_from_a_noisy_hammer_and_a_drifting_response() -> None:
    """The response by scipy's first-order hold; a drift of some times the noise and noise of the force bend nothing."""
    w = 2 * np.pi * FREQUENCY
    matrices = ([[0.0, 1.0], [-w * w, -2 * DAMPING * w]], [[0.0], [1 / MASS]], [[0.0, 1.0]], [[0.0]])
    system = signal.cont2discrete(tuple(np.array(one) for one in matrices), 1 / RATE, "foh")
    records = []
    for seed, strength in enumerate((150.0, 90.0)):
        random, true = np.random.default_rng(seed), blow(strength)
        velocity = signal.dlsim(system, true[:, None])[1][:, 0] + 6e-4 * random.standard_normal(TIME.size)
        velocity += 6e-4 * (3.0 + 2.0 * TIME + 2.0 * np.sin(2 * np.pi * 0.3 * TIME + seed))
        force = true + 0.4 + 0.3 * random.standard_normal(TIME.size)
        recording = Recording({"velocity": velocity, "force": force}, RATE, {"velocity": "m/s", "force": "N"}, "measured")
        records.append(Record(f"tap_{seed}", "excited", recording))
    believed = Model(Structure(0.92, 326.0, 0.011))
    known = catalogue()
    _, fit = model_fit(plant_of(known), [observe(one, believed) for one in records], believed, known)
    assert abs(fit.state.model.structure.mass / MASS - 1.0) < 2e-3
    assert all(square < 1.05 for square in fit.mean_squares)
