"""Sweeps on a real dask.distributed cluster of processes, whose workers are killed with SIGKILL."""

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

from testbed.problem import InputProblem
from testbed.store.data_set import read_data_set
from testbed.sweeps import sweep
from testbed.sweeps.cluster import SETTINGS, compute_on, on_cluster
from tests.support import plain_engine, sweep_kills

distributed = pytest.importorskip("distributed", reason="needs dask.distributed: pip install machining-testbed[cluster]")
RUNS = 96


@pytest.fixture(scope="module")
def cluster():
    """Two worker processes, with the tests' engines within their reach."""
    import dask

    here = os.pathsep.join([str(sweep_kills.HERE), str(sweep_kills.HERE.parent)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", here)
        dask.config.set(SETTINGS)
        with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as local, \
                distributed.Client(local) as client:
            yield client


def on(client, kill=0):
    """The batches of a sweep on a cluster; after each of the first `kill`, a worker is killed."""
    def work(job, spans):
        left = kill
        for span in compute_on(client, job, spans):
            if left:
                answers = client.run(os.getpid, on_error="return").values()  # one may have died just now
                if processes := [answer for answer in answers if isinstance(answer, int)]:
                    os.kill(processes[0], signal.SIGKILL)
                    left -= 1
            yield span
    return work


def test_killed_workers_change_nothing(cluster, tmp_path):
    scenario = sweep_kills.scenario(RUNS)
    plain = sweep.run(scenario, plain_engine.simulate, tmp_path / "a.h5")
    report = sweep.run(scenario, plain_engine.slow, tmp_path / "b.h5", workers=4, cluster=on(cluster, kill=3))
    assert report.content_hash == plain.content_hash
    data = read_data_set(report.output)
    assert data.scenario_run.tolist() == list(range(RUNS)) and set(data.outcome) == {"ok"}


def test_a_run_that_kills_its_worker_is_found_and_told_by_name(cluster, tmp_path):
    few = sweep_kills.scenario(8)
    depths = np.where(np.arange(8) == 5, plain_engine.FATAL_DEPTH, 1e-3)
    few = replace(few, tests=tuple(replace(point, axial_depth_of_cut=float(depth))
                                   for point, depth in zip(few.tests, depths, strict=True)))
    report = sweep.run(few, plain_engine.deadly, tmp_path / "a.h5", cluster=on(cluster))
    assert read_data_set(report.output).outcome.tolist() == ["crashed" if k == 5 else "ok" for k in range(8)]


def test_an_address_where_nobody_answers():
    with pytest.raises(InputProblem, match="no scheduler answers"), on_cluster("nonsense://here", None):
        pass


@pytest.mark.parametrize(("text", "said"), [
    ("kind: slurn\nworkers: 2\n", "c.yaml:1: kind"), ("kind: slurm\nworkrs: 2\n", "did you mean workers?"),
    ("kind: local\nworkers: 0\n", "c.yaml:2: workers"),
])
def test_a_cluster_file_that_is_wrong(tmp_path, monkeypatch, text, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(InputProblem) as problem, on_cluster(None, "c.yaml"):
        pass
    assert said in str(problem.value)
