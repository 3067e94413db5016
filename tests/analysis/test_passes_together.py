"""Whole numbers of a fit, the passes of entry and exit: put wrong on purpose, they come back."""

import itertools
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from testbed.analysis.fit.moves.cut_elsewhere import GAIN, _likely
from testbed.analysis.fit.moves.entries_together import REACH, best_moves
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.solve import solve
from testbed.analysis.fit.starts import base_fit
from testbed.engines import fast, predict
from tests.support.campaign_files import BELIEVED, TRUE
from tests.support.synthetic_campaign import synthetic_campaign

ENGINE = SimpleNamespace(predict_cuts=predict.predict_cuts, predict_driven=predict.predict_driven)
STABLE = ((3500, 0.8), (2600, 1.5), (3900, 2.2))


@pytest.fixture(scope="module")
def fitted():
    records = synthetic_campaign(partial(fast.simulate, steps=37), TRUE, seed=4, tests=STABLE)
    return base_fit(ENGINE, [observe(record, BELIEVED) for record in records], BELIEVED)


def _moved(fitter, fit, field, by):
    """The fit settled with one pass of the records put wrong."""
    own = tuple(replace(one, **{field: getattr(one, field) + amount})
                for one, amount in zip(fit.state.nuisances, by, strict=True))
    return fitter.fit(replace(fit.state, nuisances=own), iterations=10)


@pytest.mark.parametrize(("field", "by", "move"), [("entry", (2, 2, 1), "entries_together"), ("exit", (0, 0, 2), "pass_count")])
def test_passes_that_were_put_wrong_come_back(fitted, field, by, move):
    fitter, fit = fitted
    wrong = _moved(fitter, fit, field, by)
    assert wrong.cost > 1.5 * fit.cost
    _, again = solve(fitter, wrong, (move,))
    assert again.cost == pytest.approx(fit.cost, rel=1e-3)
    assert [getattr(one, field) for one in again.state.nuisances] == [getattr(one, field) for one in fit.state.nuisances]


def test_a_fit_down_to_its_noise_stays_as_it_is(fitted):
    fitter, fit = fitted
    assert solve(fitter, fit, ("pass_count", "entries_together"))[1] is fit


def test_the_best_moves_are_those_of_an_exhaustive_search():
    random = np.random.default_rng(1)
    for _ in range(20):
        squares = random.uniform(10.0, 20.0, (3, 2 * REACH + 1))
        pulls = random.normal(0.0, 1.5, (3, 2 * REACH + 1, 2))
        squares[2, :3] = np.inf

        def left(places, squares=squares, pulls=pulls):
            rows = np.arange(3)
            return squares[rows, places].sum() - np.sum(pulls[rows, places].sum(axis=0) ** 2)

        best = min(left(np.array(places)) for places in itertools.product(range(2 * REACH + 1), repeat=3))
        assert left(best_moves(squares, pulls) + REACH) == pytest.approx(best, rel=0.02)


@pytest.fixture(scope="module", params=[True, False], ids=["marks", "no marks"])
def quiet(request):
    """Three cuts, the last hardly louder than its noise, and their fit."""
    records = synthetic_campaign(partial(fast.simulate, steps=37), TRUE, seed=4, noise=4e-6, course=(12, 30, 10),
                                 tests=((3500, 1.5), (3900, 2.2), (2600, 0.15)))
    if not request.param:
        records = [replace(one, recording=replace(one.recording, marks=np.empty(0))) for one in records]
    return base_fit(ENGINE, [observe(record, BELIEVED) for record in records], BELIEVED)


def _begun_wrong(fitter, fit, **changes):
    """The fit settled where the last record begins otherwise."""
    return fitter.fit(fit.state.with_record(2, replace(fit.state.nuisances[2], **changes)), iterations=10)


def test_a_quiet_cut_that_was_entered_many_passes_off_is_entered_right(quiet):
    fitter, fit = quiet
    entry = fit.state.nuisances[2].entry
    wrong = _begun_wrong(fitter, fit, entry=entry - 8)
    assert wrong.cost - GAIN > fit.cost and wrong.mean_squares[2] < 1.5 and wrong.state.nuisances[2].entry == entry - 8
    _, again = solve(fitter, wrong, ("cut_elsewhere",))
    assert again.state.nuisances[2].entry == entry and again.cost == pytest.approx(fit.cost, abs=1.0)


def test_a_quiet_record_that_was_taken_to_start_in_the_cut_idles(quiet):
    fitter, fit = quiet
    entry, record = fit.state.nuisances[2].entry, replace(fitter.records[2], starts_in_cut=True)
    begun = fitter.on([*fitter.records[:2], record])
    wrong = _begun_wrong(begun, fit, entry=record.first_pass - 20, displacement=0.0, velocity=0.0)
    assert wrong.cost - GAIN > fit.cost
    found, again = solve(begun, wrong, ("cut_elsewhere",))
    assert not found.records[2].starts_in_cut and again.state.nuisances[2].entry == entry


@pytest.mark.parametrize("quiet", [False], indirect=True, ids=["no marks"])
def test_without_marks_a_tooth_angle_in_another_valley_is_found(quiet):
    fitter, fit = quiet
    own = fit.state.nuisances[2]
    wrong = _begun_wrong(fitter, fit, angle=own.angle + 2 * np.pi / 3)
    assert wrong.cost - GAIN > fit.cost
    _, again = solve(fitter, wrong, ("cut_elsewhere",))
    assert again.state.nuisances[2].angle == pytest.approx(own.angle, abs=0.05)


def test_passes_that_are_right_stay(quiet):
    fitter, fit = quiet
    assert solve(fitter, fit, ("cut_elsewhere",))[1] is fit


@pytest.mark.parametrize("quiet", [True], indirect=True, ids=["marks"])
def test_of_a_loud_record_no_move_is_worth_a_fit_and_of_a_quiet_one_every_move(quiet):
    fitter, fit = quiet
    for index, kept in ((0, 0), (2, 4)):
        own = fit.state.nuisances[index]
        moves = [replace(own, **{end: getattr(own, end) + by}) for end in ("entry", "exit") for by in (-1, 1)]
        assert len(_likely(fitter, fit, index, moves)) == kept


def test_a_record_from_within_the_cut_still_starts_there_though_its_exit_was_put_wrong():
    records = []
    for record in synthetic_campaign(partial(fast.simulate, steps=37), TRUE, seed=4, tests=STABLE, course=(12, 50, 12)):
        recording = record.recording
        later = round(0.5 * len(recording.channels["displacement"]))
        marks = recording.marks[recording.marks > later / recording.sampling_rate] - later / recording.sampling_rate
        channels = {name: values[later:] for name, values in recording.channels.items()}
        records.append(replace(record, recording=replace(recording, channels=channels, marks=marks)))
    fitter, fit = base_fit(ENGINE, [observe(record, BELIEVED) for record in records], BELIEVED)
    assert all(record.starts_in_cut for record in fitter.records)
    wrong = _begun_wrong(fitter, fit, exit=fit.state.nuisances[2].exit + 1)
    found, _ = solve(fitter, wrong, ("cut_elsewhere",))
    assert all(record.starts_in_cut for record in found.records)
