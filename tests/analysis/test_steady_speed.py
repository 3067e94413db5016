"""A swing of the speed that the vibration seems to show, held against marks that are steady."""

from dataclasses import replace
from functools import partial

import numpy as np

from testbed.analysis.fit.effect_start import all_free
from testbed.analysis.fit.fit_state import State
from testbed.analysis.fit.nuisances import Nuisances, turned_by
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.waveform import Fitter
from testbed.analysis.search.candidate_round import candidate_of
from testbed.analysis.search.steady_speed import no_swing
from testbed.api.fitting import plant_of
from testbed.catalogue import catalogue
from testbed.engines import fast
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import TESTS, synthetic_record

FREQUENCY = 3.0
FAINT = 4e-5  # by which the marks stray by 1e-4 of a revolution: steady to the eye
KNOWN = catalogue()


def observed(amplitude, marks=True):
    true = TRUE.with_effect("speed_variation", amplitude=amplitude, frequency=FREQUENCY, phase=0.6)
    made = [synthetic_record(partial(fast.simulate, steps=61), true, rpm, depth * 1e-3, 30 + number, rate=6400.0,
                             course=(12, 45, 20)) for number, (rpm, depth) in enumerate(TESTS[:2])]
    if not marks:
        made = [replace(one, recording=replace(one.recording, marks=np.empty(0))) for one in made]
    return [observe(one, BELIEVED) for one in made]


def with_swing(records, amplitude, frequency, phases=(0.0, 0.0)):
    """The set of that swing alone, as if a fit had ended there; phases (rad) of the records."""
    model = TRUE.with_effect("speed_variation", amplitude=amplitude, frequency=frequency, phase=0.0)
    fitter = Fitter(plant_of(KNOWN), records, all_free(records, model, KNOWN))
    own = tuple(turned_by(Nuisances(), "speed_variation.phase", phase) for phase in phases)
    return candidate_of(fitter, fitter.fit(State(model, 0.0, own), iterations=0), ("speed_variation",), None, 1.0)


def test_what_steady_marks_do_not_show_is_no_swing():
    records = observed(0.0)
    assert all(record.steady_marks is not None for record in records)
    assert no_swing(with_swing(records, 1e-3, FREQUENCY), KNOWN)
    assert not no_swing(with_swing(records, 1e-6, FREQUENCY), KNOWN)


def test_what_creeps_is_no_swing_with_marks_or_without():
    records = observed(0.0, marks=False)
    assert no_swing(with_swing(records, 1e-3, 0.03), KNOWN)
    assert not no_swing(with_swing(records, 1e-3, FREQUENCY), KNOWN)


def test_a_swing_too_faint_to_be_seen_in_the_marks_is_not_refuted_by_them():
    records = observed(FAINT)
    assert all(record.steady_marks is not None for record in records)
    for phase in (0.0, 1.6, 3.1):
        assert not no_swing(with_swing(records, FAINT, FREQUENCY, (phase, -phase)), KNOWN)
        assert no_swing(with_swing(records, 40 * FAINT, FREQUENCY, (phase, -phase)), KNOWN)
