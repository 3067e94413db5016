"""Sweeps whose workers, or all of whose processes, are killed with SIGKILL: every run once, the content unchanged."""

import os
import sys
import traceback
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from testbed.store.data_set import read_data_set
from testbed.sweeps import sweep
from testbed.sweeps.batch import Job, compute
from testbed.sweeps.pool import divided
from testbed.sweeps.shards import fault, find
from testbed.system import atomic
from tests.support import plain_engine, sweep_kills

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks for worker processes in /proc")
RUNS = 240


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "a.h5"
    return sweep.run(sweep_kills.scenario(RUNS), plain_engine.simulate, path)


def every_run_once(path):
    return read_data_set(path).scenario_run.tolist() == list(range(RUNS))


@pytest.mark.long
def test_twelve_killed_workers_cost_nothing(undisturbed, tmp_path):
    digest, hit = sweep_kills.kill_workers(tmp_path / "a.h5", RUNS, 12, np.random.default_rng(1))
    assert hit == 12
    assert digest == undisturbed.content_hash and every_run_once(tmp_path / "a.h5")
    assert set(read_data_set(tmp_path / "a.h5").outcome) == {"ok"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.h5"]


def test_three_kills_of_everything_cost_nothing(undisturbed, tmp_path):
    digest, hit = sweep_kills.kill_whole(tmp_path / "a.h5", RUNS, 3, np.random.default_rng(2))
    assert hit == 3
    assert digest == undisturbed.content_hash and every_run_once(tmp_path / "a.h5")


def test_a_run_that_hangs_is_ended_and_told_by_name(tmp_path):
    short = replace(sweep_kills.scenario(4), tests=tuple(
        replace(point, axial_depth_of_cut=depth) for point, depth in
        zip(sweep_kills.scenario(4).tests, (1e-3, plain_engine.FATAL_DEPTH, 1.5e-3, 3e-3), strict=True)))
    report = sweep.run(short, plain_engine.hanging, tmp_path / "a.h5", workers=2, processes=True, stall=0.6)
    assert read_data_set(report.output).outcome.tolist() == ["ok", "limit", "ok", "ok"]


def test_a_span_is_divided_about_the_run_under_way():
    assert divided((0, 8), 5) == [(0, 5), (5, 6), (6, 8)]
    assert divided((0, 8), 0) == [(0, 1), (1, 8)] and divided((0, 8), 7) == [(0, 7), (7, 8)]
    assert divided((0, 8), 8) == [(0, 4), (4, 8)]  # while it wrote


def test_runs_that_stand_in_two_shards_are_taken_once(undisturbed, tmp_path):
    def twice(job, spans):
        for first, last in spans:
            middle = (first + last) // 2
            for span in ((first, middle), (middle, last), (first, last)):
                compute(job, *span)
            yield first, last

    report = sweep.run(sweep_kills.scenario(RUNS), plain_engine.simulate, tmp_path / "a.h5", cluster=twice)
    assert report.content_hash == undisturbed.content_hash and every_run_once(tmp_path / "a.h5")


def test_a_shard_is_whole_or_not_there_wherever_its_writing_is_cut(tmp_path):
    """The process is killed at each of the file operations of a shard's writing in turn, until one writing survives."""
    scenario = sweep_kills.scenario(6)
    header = sweep._header(scenario, "", {}, ())
    job = Job(scenario, header, plain_engine.simulate, tmp_path, scenario.longest(), 2)
    killed = survived = 0
    while not survived:
        child = os.fork()
        if child == 0:
            try:
                _die_at(killed)
                compute(job, 0, 6)
            except BaseException:
                traceback.print_exc()
                os._exit(1)  # else the child would go on with the other tests
            os._exit(0)
        _, status = os.waitpid(child, 0)
        shards = find(tmp_path)
        if os.WIFSIGNALED(status):
            killed += 1
            assert all(fault(path, header.fingerprint) is None for _, _, path in shards)
            for _, _, path in shards:
                path.unlink()
        else:
            assert os.WEXITSTATUS(status) == 0 and len(shards) == 1 and fault(shards[0][2]) is None
            survived += 1
    assert killed >= 12


def _die_at(number):
    """Kill this process before file operation `number` (from 0): Python's own, and those that have HDF5 write."""
    import h5py

    from testbed.store import store
    from testbed.store.chunk_writer import ChannelWriter

    left = [number]

    def counted(function):
        def then(*arguments, **options):
            if left[0] == 0:
                os.kill(os.getpid(), 9)
            left[0] -= 1
            return function(*arguments, **options)
        return then

    for name in ("chmod", "unlink", "open"):
        setattr(Path, name, counted(getattr(Path, name)))
    for name in ("replace", "close", "fsync"):
        setattr(atomic.os, name, counted(getattr(os, name)))
    atomic.tempfile.mkstemp = counted(atomic.tempfile.mkstemp)
    h5py.File.close = counted(h5py.File.close)
    h5py.File.__exit__ = lambda self, *_: self.close() if self.id else None
    h5py.Dataset.__setitem__ = counted(h5py.Dataset.__setitem__)
    ChannelWriter.flush = counted(ChannelWriter.flush)
    store.seal = counted(store.seal)
