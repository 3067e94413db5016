"""The n-th write or allocation fails: a few n of a sweep and of an export (all of them: tests/validation/adversities)."""

import itertools

import pytest

from testbed.cli import main
from testbed.sweeps import sweep
from tests.support import faults, plain_engine, sweep_kills

STEP = {"ENOSPC": 160, "EIO": 190, "MemoryError": 260, "Ctrl-C": 170}
SIZES = (0, 150, 20_000, 28_000, 30_500)  # bytes; a shard has 28,000, the whole 31,000


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    target = tmp_path_factory.mktemp("whole") / "a.h5"
    sweep.run(sweep_kills.scenario(faults.RUNS), plain_engine.simulate, target)
    return target


@pytest.mark.parametrize("kind", STEP)
def test_a_sweep_loses_nothing_when_a_write_or_an_allocation_fails(data, tmp_path, kind):
    from testbed.store.data_set import read_data_set

    wanted, struck = read_data_set(data).content_hash, []
    for number in itertools.count(7, STEP[kind]):
        folder = tmp_path / str(number)
        folder.mkdir()
        fault, wrong = faults.sweep_with(folder, faults.failing(kind, number), bool(number % 2), wanted)
        assert not wrong, (number, fault.where, wrong)
        if not fault.where:
            break
        struck.append(fault.where)
    assert len(struck) >= 4


@pytest.mark.parametrize("size", SIZES)
def test_a_sweep_loses_nothing_when_files_may_not_grow(data, tmp_path, size):
    from testbed.store.data_set import read_data_set

    _, wrong = faults.sweep_with(tmp_path, faults.full_at(size), False, read_data_set(data).content_hash)
    assert not wrong


@pytest.mark.parametrize("kind", ("ENOSPC", "EIO", "MemoryError"))
def test_an_export_is_whole_or_not_there(data, tmp_path, kind):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra formats)")
    with pytest.raises(SystemExit):
        main(["export", str(data), "-o", str(tmp_path / "whole"), "--quiet"])
    wanted, struck = faults.shards_of(tmp_path / "whole"), 0
    assert wanted
    for number in itertools.count(1, 5):
        folder = tmp_path / str(number)
        folder.mkdir()
        fault, wrong = faults.export_with(folder, data, faults.failing(kind, number), wanted)
        assert not wrong, (number, fault.where, wrong)
        if not fault.where:
            break
        struck += 1
    assert struck >= 4
