"""What a user names is looked at before it is opened: one line, exit code 2, no hang. A quick part of the adversities."""

import errno
import os
import resource
from pathlib import Path

import h5py
import numpy as np
import pytest
from validation.adversities import measured_files, own_effects, paths, written_texts

from testbed.analysis.fit.fit_state import Jacobian
from testbed.analysis.fit.observe import observe
from testbed.analysis.fit.thinning import ENOUGH, every_nth
from testbed.catalogue import catalogue
from testbed.files.campaign import load_campaign
from testbed.files.door import free_memory, is_shortage, plain_file
from testbed.files.model_file import read_model
from testbed.problem import InputProblem, shortened
from testbed.recording import Recording
from testbed.store.data_set import is_data_set
from testbed.system.child import tried
from tests.support.campaign_files import BELIEVED


@pytest.mark.parametrize("place", paths.PLACES)
def test_what_is_no_plain_file_is_refused_by_what_it_is(place, tmp_path):
    path = paths.PLACES[place](tmp_path / "cut.csv")
    if place in ("empty", "random bytes"):
        assert plain_file(path).st_size == path.stat().st_size
        return
    with pytest.raises(InputProblem) as said:
        plain_file(path)
    assert len(str(said.value)) < 700


QUICK = [name for name in measured_files.MEASURED if not name.startswith("HDF5: 5000") and "20,000" not in name]


@pytest.mark.parametrize("name", QUICK)
def test_hostile_measured_files_end_in_one_line(name, tmp_path):
    make, codes = measured_files.MEASURED[name]
    make(tmp_path)
    try:
        load_campaign(tmp_path / "campaign.yaml")
        assert 0 in codes, "it was read"
    except InputProblem as problem:
        assert "\n" not in str(problem)


@pytest.mark.parametrize("name", [name for name in written_texts.WRITTEN if name.startswith("model") and "300,000" not in name])
def test_hostile_models_end_in_one_line(name, tmp_path):
    make, codes = written_texts.WRITTEN[name]
    make(tmp_path)
    try:
        read_model(tmp_path / "model.yaml")
        assert 0 in codes, "it was read"
    except InputProblem as problem:
        assert "\n" not in str(problem) and len(str(problem)) < 1000


def own(folder: Path, line: str, beside: str = "") -> Path:
    (folder / "law.py").write_text(own_effects.LAW.replace("LINE", line))
    (folder / "beside.py").write_text(beside)
    return folder


@pytest.mark.parametrize("name", [name for name in own_effects.BAD_LAWS if name not in ("text", "never ends at all")])
def test_a_bad_law_is_told_by_name(name, tmp_path):
    with pytest.raises(InputProblem, match=r"structure_force\(\)"):
        catalogue(own(tmp_path, own_effects.BAD_LAWS[name]))


def test_a_script_beside_an_effect_is_not_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "precious").write_text("kept")
    assert "law" in catalogue(own(tmp_path, "return strength * velocity", own_effects.DELETES))
    assert (tmp_path / "precious").exists()


def test_a_file_that_means_to_be_an_effect_and_defines_none_is_told(tmp_path):
    (tmp_path / "law.py").write_text("from testbed.effect import Effect\neffect = Effect\n")
    with pytest.raises(InputProblem, match="no EFFECT"):
        catalogue(tmp_path)


def test_a_child_that_dies_or_never_ends_is_seen():
    assert tried(lambda progress: progress("so far"), 5.0).said == ("so far",)
    assert tried(lambda progress: os._exit(0), 5.0).how == "failed"
    assert tried(lambda progress: os.kill(os.getpid(), 9), 5.0)[:2] == ("killed", 9)
    assert tried(lambda progress: [None for _ in iter(int, 1)], 1.0).how in ("too late", "failed")


def test_a_long_name_is_shown_by_its_ends():
    assert shortened("a" * 5000 + "b").endswith("b") and len(shortened("a" * 5000)) < 350


def test_long_records_are_thinned_and_short_ones_are_not():
    assert every_nth(ENOUGH, 51200.0, 147.0) == 1
    assert every_nth(60 * 51200, 51200.0, 147.0, 63.5) == 8  # no slower than 40 samples a swing
    assert every_nth(60 * 51200, 51200.0, 2000.0) == 1


def test_a_thinned_record_holds_every_nth_sample_at_its_own_moment():
    from testbed.files.campaign import Record
    from testbed.files.manifest import Feed

    rate, count = 51200.0, 2 * ENOUGH + 1000
    time = np.arange(count) / rate
    signal = 2e-5 * np.sin(2 * np.pi * 63.5 * time) + 1e-6 * np.random.default_rng(1).standard_normal(count)
    conditions = {"spindle_speed": 399.0, "axial_depth_of_cut": 1e-3, "feed_per_tooth": 1e-4}
    recording = Recording({"displacement": signal}, rate, {"displacement": "m"}, "measured", conditions=conditions)
    found = observe(Record("long", "cut", recording, conditions, feed=Feed(1e-4, "tooth")), BELIEVED)
    assert found.every == 3 and found.rate == rate / 3
    assert np.array_equal(found.data[0], signal[::3]) and len(found.drift) == found.samples


def test_residuals_of_many_rows_lose_the_same_whether_worked_on_together_or_not(monkeypatch):
    random = np.random.default_rng(2)
    part = Jacobian(random.standard_normal(50), random.standard_normal((50, 2)), random.standard_normal((50, 3)))
    rows = random.standard_normal((7, 50))
    whole = part.without_own(rows)
    monkeypatch.setattr("testbed.analysis.fit.fit_state.VALUES_TOGETHER", 10)
    assert np.allclose(part.without_own(rows), whole, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("problem", "short"), [
    (MemoryError(), True), (OSError(errno.ENOMEM, "no room"), True), (OSError(errno.ENOENT, "none"), False),
    (ImportError("libopenblas.so: failed to map segment from shared object"), True), (ImportError("no module named x"), False)])
def test_want_of_memory_is_told_whatever_a_library_makes_of_it(problem, short):
    assert is_shortage(problem) == short
    later = RuntimeError("your install seems to be broken")
    later.__cause__ = problem
    assert is_shortage(later) == short


def test_free_memory_is_no_more_than_the_limit_of_the_process():
    def limited(progress):
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (taken + 50_000_000, resource.RLIM_INFINITY))
        progress(str(free_memory()))

    found = tried(limited, 10.0)
    assert 0.0 < float(found.said[0]) <= 50e6 < free_memory()


def test_a_file_whose_attributes_are_damaged_is_no_data_set(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.attrs.update(format=3, scenario_fingerprint="x")
    assert is_data_set(tmp_path / "a.h5")

    def damaged(*_):
        raise RuntimeError("ran off end of input buffer while decoding")

    monkeypatch.setattr(h5py.AttributeManager, "__contains__", damaged)
    assert not is_data_set(tmp_path / "a.h5")
