"""A stranger's programs open the set: each test uses one of them and nothing of the testbed."""

import numpy as np
import pytest

from tests.support.export_files import export

pytest.importorskip("pyarrow", reason="pyarrow is not installed (extra formats)")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    return export(tmp_path_factory.mktemp("opens"))


def test_pandas(exported):
    pandas = pytest.importorskip("pandas", reason="pandas is not installed (extra dev)")
    whole = pandas.read_parquet(exported[1] / "data")
    assert len(whole) == 48 and whole["run"].is_unique and whole["group"].nunique() == 24
    row = whole.set_index("run").loc[0]
    assert row["displacement"].dtype == np.float32 and 1e-6 < np.std(row["displacement"]) < 1e-3
    assert whole["contact_loss"].dtype == bool and whole.groupby("group")["stability"].nunique().max() == 1


def test_datasets_without_a_network(exported, tmp_path, monkeypatch):
    datasets = pytest.importorskip("datasets", reason="datasets is not installed (extra dev)")
    monkeypatch.setattr(datasets.config, "HF_HUB_OFFLINE", True)
    found = datasets.load_dataset(str(exported[1]), cache_dir=str(tmp_path))
    assert set(found) == {"train", "validation", "test"} and sum(map(len, found.values())) == 48
    one = found["test"].with_format("numpy")[0]
    assert one["displacement"].dtype == np.float32 and one["displacement"].size > 4000 and one["sampling_rate"] == 6400
    assert not set(found["train"]["group"]) & set(found["test"]["group"])


def test_mlcroissant(exported):
    mlcroissant = pytest.importorskip("mlcroissant", reason="mlcroissant is not installed; it is in no extra, for its size")
    found = mlcroissant.Dataset(exported[1] / "croissant.json")
    assert not list(found.metadata.issues.errors)
    first = next(iter(found.records("train")))
    assert len(first["train/displacement"]) > 4000 and first["train/sampling_rate"] == 6400
    assert first["train/stability"] in (b"stable", b"neimark_sacker", b"flip")


def test_xarray_reads_the_data_set(exported):
    xarray = pytest.importorskip("xarray", reason="xarray is not installed (extra dev)")
    pytest.importorskip("h5netcdf", reason="h5netcdf is not installed (extra dev)")
    with xarray.open_dataset(exported[0], engine="h5netcdf") as found:
        assert found["displacement"].dims == ("run", "time") and found["displacement"].attrs["units"] == "m"
        assert found.sizes["run"] == 48 and 1e-6 < float(found["displacement"][0].std()) < 1e-3
        assert float(found["truth.damping_ratio"][0]) == 0.0032


def test_xarray_takes_the_exported_columns(exported):
    xarray = pytest.importorskip("xarray", reason="xarray is not installed (extra dev)")
    pandas = pytest.importorskip("pandas", reason="pandas is not installed (extra dev)")
    columns = ["run", "spindle_speed", "largest_multiplier_modulus"]
    found = xarray.Dataset.from_dataframe(pandas.read_parquet(exported[1] / "data", columns=columns).set_index("run"))
    assert found.sizes["run"] == 48 and float(found["spindle_speed"].sel(run=0)) == pytest.approx(2600 * np.pi / 30)


def test_plain_h5py_reads_the_data_set(exported):
    import h5py

    with h5py.File(exported[0]) as file:
        data = file["displacement"]
        values = data[0] * data.attrs["scale_factor"]
        assert file["spindle_speed"].attrs["units"] == "rad/s" and data.shape[0] == 48
        assert 1e-6 < np.std(values[: file["sample_count"][0]]) < 1e-3
