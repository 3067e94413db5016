"""docs/train.md: every recipe runs on a set that `testbed export` wrote, and its scores beat the commonest class."""

from pathlib import Path

import numpy as np
import pytest

import testbed.scenarios
from tests.support import doc_pages
from tests.support.export_files import run, simulate

pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra formats)")
SCENARIO = (Path(testbed.scenarios.__file__).parent / "random_machines.yaml").read_text("utf-8")
BLOCKS = doc_pages.blocks(doc_pages.read("train.md"), "python")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with `windows`, as the page makes it, of a quarter of the runs."""
    place = tmp_path_factory.mktemp("train")
    assert "runs: 256" in SCENARIO
    data = simulate(place, SCENARIO.replace("runs: 256", "runs: 64"))
    export = next(line for line in doc_pages.blocks(doc_pages.read("train.md"), "sh")[0].splitlines() if " export " in line)
    options = export.split("-o windows ")[1].split()
    assert run("export", data, "-o", place / "windows", "--quiet", *options) == 0
    return place


def executed(begins, folder, monkeypatch):
    """The names that the block with this line has defined, run in the folder."""
    monkeypatch.chdir(folder)
    block = next(block for block in BLOCKS if begins in block)
    names = {}
    exec(compile(block, "docs/train.md", "exec"), names)
    return names


def test_scikit_learn(folder, monkeypatch):
    pytest.importorskip("sklearn", reason="scikit-learn is not installed (extra dev)")
    scores = executed("RandomForestClassifier", folder, monkeypatch)["scores"]
    assert scores["forest"] > scores["commonest class"] + 0.15 and scores["commonest class"] == 0.5


def test_pytorch(folder, monkeypatch):
    pytest.importorskip("torch", reason="PyTorch is not installed; it is in no extra, for its size")
    found = executed("nn.Conv1d", folder, monkeypatch)
    assert set(found["recalls"]) <= set(found["CLASSES"]) and np.mean(list(found["recalls"].values())) > 0.45


def test_numpy(folder, monkeypatch):
    import pyarrow.parquet as pq

    found = executed("open_memmap", folder, monkeypatch)
    rows = pq.read_table(found["files"]).to_pylist()
    assert isinstance(found["signals"], np.memmap) and found["signals"].shape == (len(rows), 1024)
    for place in (0, len(rows) // 2, len(rows) - 1):
        assert np.array_equal(found["signals"][place], np.float32(rows[place]["displacement"]))
        assert found["chatter"][place] is rows[place]["chatter"]
    assert found["chatter"].isna().any() and 1e-6 < float(found["signals"].std()) < 1e-2


def test_the_page_names_columns_that_are_there(folder):
    import pyarrow.parquet as pq

    columns = set(pq.read_schema(next((folder / "windows" / "data").iterdir())).names)
    told = doc_pages.tables(doc_pages.read("train.md"))["What a row holds"].keys()
    assert len(told) > 12 and {name for name in told if name not in columns} <= {"...", "true_..."}
