"""Data sets: what is written reads back, by us and by xarray; what is damaged or unsafe is refused."""

import os
import zlib
from dataclasses import replace

import h5py
import numpy as np
import pytest

from testbed.cut import Cut, Sampling
from testbed.files.hdf5_guard import opened
from testbed.files.model_file import model_text
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.problem import InputProblem
from testbed.recording import Recording
from testbed.scenario.scenario import Run
from testbed.sensors.chain import ChannelSensor, SensorChain
from testbed.store.chunk_writer import COMPRESSIONS, deflated, fletcher32
from testbed.store.content_hash import content_hash, row_digest
from testbed.store.data_set import is_data_set, read_data_set
from testbed.store.seal import sealed_size
from testbed.store.store import Header, block_of, write_data_set
from testbed.sweeps.batch import nothing

MODEL = Model(Structure(2.573, 146.6, 0.0032), Cutter(), Cutting(), {"process_damping": {"coefficient": 1e5}})
RATE = 1000.0
CONVERTER = ChannelSensor(noise=1e-6, bits=16, full_scale=1e-3)
HEADER = Header("trial", 7, "fast", RATE, 1, "name: trial\n", model_text(MODEL), "<mujoco/>", "f" * 64,
                {"process_damping.coefficient": "N/m"}, {"numpy": "2"})


def run_and_recording(index, samples, sensor=CONVERTER, channel="displacement"):
    run = Run(index, MODEL, Cut(400.0 + index, 1e-3 * (index + 1)), Sampling(RATE, samples),
              SensorChain({channel: sensor}, mark_angle=0.3), 7)
    unit = {"displacement": "m", "velocity": "m/s"}[channel]
    time = np.arange(samples) / RATE
    predicted = Recording({channel: 1e-4 * np.sin((300 + 10 * index) * time)}, RATE, {channel: unit}, "predicted",
                          marks=np.arange(1 + index) * 0.01, pass_times=np.arange(3 + index) * 0.01)
    return run, run.sensors.apply(predicted, run.sensed())


def blocks(rows):
    return (block_of(*row) for row in rows)


def written(path, rows):
    count = max(len(recording) for _, recording in rows)
    write_data_set(path, HEADER, blocks(rows), len(rows), count)
    return rows


@pytest.fixture
def trial(tmp_path):
    path = tmp_path / "trial.h5"
    rows = written(path, [run_and_recording(index, 200 + 50 * index) for index in range(3)])
    return path, rows


def test_what_was_recorded_reads_back_exactly(trial):
    path, rows = trial
    data = read_data_set(path)
    assert len(data) == 3
    for (run, before), after in zip(rows, data, strict=True):
        assert np.std(before.channels["displacement"]) > 1e-5
        assert np.array_equal(after.channels["displacement"], before.channels["displacement"])
        assert np.array_equal(after.marks, before.marks) and np.array_equal(after.pass_times, before.pass_times)
        assert (after.origin, after.outcome, after.units["displacement"]) == ("synthetic", "ok", "m")
        assert after.conditions["spindle_speed"] == run.cut.spindle_speed
    assert np.array_equal(data.recording(2).channels["displacement"], rows[2][1].channels["displacement"])


def test_conditions_truth_and_texts(trial):
    data = read_data_set(trial[0])
    assert data.conditions["axial_depth_of_cut"] == pytest.approx([1e-3, 2e-3, 3e-3])
    assert data.truth["natural_frequency"].tolist() == [146.6] * 3 and data.truth["mark_angle"].tolist() == [0.3] * 3
    assert data.truth["process_damping.coefficient"].tolist() == [1e5] * 3
    assert data.noise["displacement"].tolist() == [1e-6] * 3
    assert data.true_model() == MODEL
    assert (data.seed, data.engine, data.scenario_text, data.model_xml) == (7, "fast", "name: trial\n", "<mujoco/>")


def test_samples_are_stored_as_the_converters_counts_with_checksums(trial):
    with h5py.File(trial[0]) as file:
        data = file["displacement"]
        assert data.dtype == np.int16 and data.attrs["scale_factor"] == CONVERTER.step
        assert data.compression == "gzip" and data.shuffle and data.fletcher32
        assert data[0, -1] == data.attrs["_FillValue"] == -32768


@pytest.mark.parametrize(("sensor", "kind", "rel"), [(ChannelSensor(), np.float32, 1e-7),
                                                     (ChannelSensor(bits=24, full_scale=1e-3), np.int32, 0)])
def test_other_ways_of_storing(tmp_path, sensor, kind, rel):
    rows = written(tmp_path / "a.h5", [run_and_recording(0, 100, sensor, "velocity")])
    with h5py.File(tmp_path / "a.h5") as file:
        assert file["velocity"].dtype == kind
    found = read_data_set(tmp_path / "a.h5").recording(0)
    assert found.channels["velocity"] == pytest.approx(rows[0][1].channels["velocity"], rel=rel or 1e-15, abs=0)


@pytest.mark.parametrize("compression", COMPRESSIONS)
def test_however_it_is_packed_the_content_is_the_same(tmp_path, trial, compression):
    if compression == "zstd":
        pytest.importorskip("hdf5plugin")
    rows = trial[1]
    digest = write_data_set(tmp_path / "a.h5", HEADER, blocks(rows), 3, 300, compression=compression, chunk_rows=2)
    assert digest == read_data_set(trial[0]).content_hash
    for (_, before), after in zip(rows, read_data_set(tmp_path / "a.h5"), strict=True):
        assert np.array_equal(after.channels["displacement"], before.channels["displacement"])


def test_each_runs_digest_is_that_of_its_samples(trial):
    with h5py.File(trial[0]) as file:
        kept = [row.tobytes() for row in file["digest_displacement"][()]]
        assert kept == [row_digest(row) for row in file["displacement"][()]] and len(set(kept)) == 3


def test_packed_planes_are_a_plain_zlib_stream():
    rng = np.random.default_rng(0)
    planes = np.stack([rng.integers(256, size=50_001), np.arange(50_001) // 5000]).astype(np.uint8)  # noise, and steps
    packed = deflated(planes)
    assert zlib.decompress(packed) == planes.tobytes()
    assert 50_001 < len(packed) < 51_000  # the noise as it is, the steps nearly for nothing


def plain_fletcher(data):
    """The checksum as its definition says, word by word."""
    first = second = 0
    for at in range(0, len(data), 2):
        first = (first + int.from_bytes(data[at:at + 2].ljust(2, b"\0"), "big")) % 65535
        second = (second + first) % 65535
    return first, second


@pytest.mark.parametrize("size", [1, 2, 7, 16_384, 16_386, 40_001])
def test_the_checksum_is_fletchers(size):
    data = np.random.default_rng(size).bytes(size)
    found = fletcher32(data)
    assert ((found & 0xFFFF) % 65535, (found >> 16) % 65535) == plain_fletcher(data)
    assert fletcher32(bytes(size)) == 0 and fletcher32(b"\xff" * (size + size % 2)) & 0xFFFF == 0xFFFF


def test_xarray_opens_it(trial):
    xarray = pytest.importorskip("xarray")
    path, rows = trial
    with xarray.open_dataset(path, engine="h5netcdf") as found:
        assert found.displacement.dims == ("run", "time") and found.displacement.attrs["units"] == "m"
        values = found.displacement.values
        assert np.array_equal(values[0, :200], rows[0][1].channels["displacement"]) and np.isnan(values[0, 200:]).all()
        assert np.array_equal(found.time.values[:3], [0.0, 1e-3, 2e-3])
        assert found.outcome.attrs["flag_meanings"] == "ok diverged limit crashed"
        assert all("units" in found[name].attrs or "flag_meanings" in found[name].attrs or found[name].ndim == 0
                   for name in found.variables)
        assert all("long_name" in found[name].attrs for name in found.variables)


def test_a_run_that_failed_is_a_row_with_its_outcome(tmp_path):
    run, good = run_and_recording(0, 100)
    half = replace(good, outcome="diverged", outcome_time=0.05,
                   channels={"displacement": np.where(np.arange(100) < 50, good.channels["displacement"], np.nan)})
    written(tmp_path / "a.h5", [(run, half), (replace(run, index=1), nothing(run, "crashed"))])
    first, second = read_data_set(tmp_path / "a.h5")
    assert (first.outcome, first.outcome_time, second.outcome) == ("diverged", 0.05, "crashed")
    assert np.array_equal(first.channels["displacement"], half.channels["displacement"], equal_nan=True)
    assert len(second) == 1


def test_a_long_record_spans_chunks(tmp_path):
    rows = written(tmp_path / "a.h5", [run_and_recording(index, 700_000) for index in range(2)])
    for (_, before), after in zip(rows, read_data_set(tmp_path / "a.h5"), strict=True):
        assert np.array_equal(after.channels["displacement"], before.channels["displacement"])


def test_the_content_hash_is_of_the_content(tmp_path, trial):
    rows = trial[1]
    again = write_data_set(tmp_path / "b.h5", HEADER, blocks(rows), 3, 300)
    assert again == read_data_set(trial[0]).content_hash and read_data_set(trial[0]).verify()
    other = replace(rows[1][1], channels={"displacement": rows[1][1].channels["displacement"].copy()})
    other.channels["displacement"][17] += CONVERTER.step
    assert write_data_set(tmp_path / "c.h5", HEADER, blocks([rows[0], (rows[1][0], other), rows[2]]), 3, 300) != again
    assert write_data_set(tmp_path / "d.h5", replace(HEADER, seed=8), blocks(rows), 3, 300) != again


def test_verify_sees_a_changed_value(trial):
    with h5py.File(trial[0], "r+") as file:
        file["spindle_speed"][0] += 1e-9
    with pytest.raises(InputProblem, match="was changed after it was written"):
        read_data_set(trial[0])


def test_the_hash_does_not_see_how_values_are_stored(tmp_path):
    values = np.arange(1000.0).reshape(10, 100)
    with h5py.File(tmp_path / "a.h5", "w") as one, h5py.File(tmp_path / "b.h5", "w") as other:
        one["x"] = values
        other.create_dataset("x", data=values, chunks=(3, 7), compression="gzip")
        assert content_hash(one) == content_hash(other)
        other["x"].attrs["units"] = "m"
        assert content_hash(one) != content_hash(other)


def test_a_file_appears_whole_or_not_at_all(tmp_path, trial):
    def breaking():
        yield trial[1][0]
        raise RuntimeError("power cut")

    with pytest.raises(RuntimeError):
        write_data_set(tmp_path / "new.h5", HEADER, blocks(breaking()), 3, 300)
    assert [path.name for path in tmp_path.iterdir()] == ["trial.h5"]
    with pytest.raises(InputProblem):
        write_data_set(tmp_path / "none" / "new.h5", HEADER, blocks(trial[1]), 3, 300)


@pytest.mark.parametrize("share", [0.0, 0.01, 0.3, 0.6, 0.9, 0.999])
def test_a_truncated_file_is_an_input_problem(trial, share):
    path = trial[0]
    os.truncate(path, int(os.path.getsize(path) * share))
    with pytest.raises(InputProblem) as problem:
        list(read_data_set(path))
    assert "\n" not in str(problem.value)


def test_damaged_bytes_are_refused(trial):
    path = trial[0]
    whole = path.read_bytes()
    rng = np.random.default_rng(2)
    for _ in range(20):
        at = int(rng.integers(len(whole) - 16))
        path.write_bytes(whole[:at] + bytes(rng.integers(256, size=16, dtype=np.uint8)) + whole[at + 16:])
        with pytest.raises(InputProblem):
            list(read_data_set(path))


def test_damaged_bytes_without_a_seal_are_refused_or_have_touched_no_sample(trial):
    path, rows = trial
    whole = path.read_bytes()[:sealed_size(path)]
    rng = np.random.default_rng(3)
    refused = 0
    for _ in range(30):
        at = int(rng.integers(len(whole) - 16))
        path.write_bytes(whole[:at] + bytes(rng.integers(256, size=16, dtype=np.uint8)) + whole[at + 16:])
        try:
            for (_, before), after in zip(rows, read_data_set(path), strict=False):
                size = min(len(after), len(before))
                assert np.array_equal(after.channels["displacement"][:size], before.channels["displacement"][:size])
        except InputProblem:
            refused += 1
    assert 3 < refused < 30


def test_what_is_no_data_set_is_refused_with_advice(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = np.arange(3)
    assert not is_data_set(tmp_path / "other.h5") and not is_data_set(tmp_path / "none.h5")
    with pytest.raises(InputProblem, match="campaign.yaml"):
        read_data_set(tmp_path / "other.h5")
    for path in (tmp_path / "none.h5", tmp_path):
        with pytest.raises(InputProblem):
            read_data_set(path)


def _external_storage(file, folder):
    (folder / "secret").write_bytes(bytes(800))
    file.create_dataset("x", (100,), "f8", external=[(str(folder / "secret"), 0, 800)])


def _virtual(file, folder):
    with h5py.File(folder / "source.h5", "w") as source:
        source["y"] = np.arange(10)
    layout = h5py.VirtualLayout((10,), "i8")
    layout[:] = h5py.VirtualSource(str(folder / "source.h5"), "y", (10,))
    file.create_virtual_dataset("x", layout)


def _external_link(file, folder):
    file["x"] = h5py.ExternalLink("/etc/hosts", "/")


def _soft_link(file, folder):
    file.create_group("g")["x"] = h5py.SoftLink("/elsewhere")


def _bomb(file, folder):
    file.create_dataset("x", (2**27,), "f8", chunks=(2**20,), compression="gzip", fillvalue=0.0)


def _huge(file, folder):
    file.create_dataset("x", (2**50,), "f8", chunks=(2**20,))


@pytest.mark.parametrize("make", [_external_storage, _virtual, _external_link, _soft_link, _bomb, _huge])
def test_unsafe_files_are_refused_before_a_value_is_read(tmp_path, make):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        make(file, tmp_path)
    with pytest.raises(InputProblem), opened(tmp_path / "a.h5"):
        pass


def test_a_loop_of_groups_and_plain_files_pass(tmp_path, trial):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_group("g")["again"] = file["/"]
        file["x"] = np.zeros(10)
    with opened(tmp_path / "a.h5") as file:
        assert "x" in file
    with opened(trial[0]) as file:
        assert "displacement" in file
