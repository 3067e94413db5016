"""Small measured-looking files of every format that the readers know, for tests: two channels, 12.8 kHz."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import scipy.io

from testbed.readers.assemble import Source

RATE = 12800.0
ROWS = 640
FORMATS = ("csv", "tsv", "dynoware", "labview", "mat", "mat73", "hdf5", "wav", "tdms", "uff", "parquet")


def signals(rows: int = ROWS, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Displacement (um) and force (N), each (rows,), already rounded to what text files print."""
    random = np.random.default_rng(seed)
    time = np.arange(rows) / RATE
    moved = (
        20 * np.sin(2 * np.pi * 146.6 * time) + 5 * np.sin(2 * np.pi * 63.5 * time) + 0.2 * random.standard_normal(rows)
    )
    force = 40 * np.cos(2 * np.pi * 63.5 * time) ** 3 + 0.3 * random.standard_normal(rows)
    return np.round(moved, 5), np.round(force, 5)


def write(kind: str, folder: Path) -> Path:
    """A file of one format in `folder`."""
    disp, force = signals()
    time = np.arange(len(disp)) / RATE
    path = folder / f"record_{kind}.{_ENDINGS.get(kind, kind)}"
    rows = list(zip(time, disp, force, strict=True))
    if kind == "csv":
        path.write_text("time [s],disp [um],force [N]\n" + "".join(f"{t:.8f},{d:.5f},{f:.5f}\n" for t, d, f in rows))
    elif kind == "tsv":
        body = "".join(f"{t:.8f}\t{d:.5f}\t{f:.5f}\r\n".replace(".", ",") for t, d, f in rows)
        path.write_bytes(("time\tdisp\tforce\r\ns\tum\tN\r\n" + body).encode("utf-16"))
    elif kind == "dynoware":
        junk = "DynoWare,Version 2.5.1.2\nPath:,C:\\data\nDate:, \nSampling rate [Hz]:,12800\nTime,disp,force\ns,um,N\n"
        path.write_text(junk + "".join(f"{t:.8f},{d:.5f},{f:.5f}\n" for t, d, f in rows))
    elif kind == "labview":
        junk = (
            "LabVIEW Measurement\nWriter_Version\t2\nSeparator\tTab\nTime\t10:15:30.5\n***End_of_Header***\t\n\n"
            "Channels\t2\t\t\nSamples\t640\t640\t\nX_Dimension\tTime\tTime\t\nDelta_X\t0.000078\t0.000078\t\n"
            "***End_of_Header***\t\t\t\nX_Value\tdisp\tforce\tComment\n"
        )
        path.write_text(junk + "".join(f"{t:.8f}\t{d:.5f}\t{f:.5f}\n" for t, d, f in rows))
    else:
        _write_binary(kind, path, disp, force)
    return path


_ENDINGS = {"dynoware": "csv", "labview": "lvm", "mat73": "mat", "hdf5": "h5", "tsv": "txt"}


def _write_binary(kind: str, path: Path, disp: np.ndarray, force: np.ndarray) -> None:
    if kind == "mat":
        scipy.io.savemat(path, {"disp": disp[:, None], "force": force[:, None], "fs": RATE}, do_compression=True)
    elif kind == "mat73":
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in (("disp", disp), ("force", force)):
                file.create_dataset(name, data=values[None, :]).attrs["MATLAB_class"] = np.bytes_(b"double")
        with path.open("r+b") as stream:
            stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
    elif kind == "hdf5":
        with h5py.File(path, "w") as file:
            group = file.create_group("measurement")
            group.attrs["sampling_rate"] = RATE
            for name, values, unit in (("disp", disp, "um"), ("force", force, "N")):
                data = group.create_dataset(name, data=values, chunks=(64,), compression="gzip", fletcher32=True)
                data.attrs["units"] = unit
    elif kind == "wav":
        counts = np.stack([disp * 800, force * 500], axis=1).astype(np.int16)
        scipy.io.wavfile.write(path, int(RATE), counts)
    elif kind == "tdms":
        from nptdms import ChannelObject, TdmsWriter

        with TdmsWriter(path) as writer:
            writer.write_segment(
                [
                    ChannelObject("rig", name, values, properties={"wf_increment": 1 / RATE, "unit_string": unit})
                    for name, values, unit in (("disp", disp, "um"), ("force", force, "N"))
                ]
            )
    elif kind == "uff":
        _write_uff(path, disp, force)
    elif kind == "parquet":
        import pyarrow as arrow
        import pyarrow.parquet as parquet

        fields = [
            arrow.field("disp", arrow.float64(), metadata={"unit": "um"}),
            arrow.field("force", arrow.float64(), metadata={"unit": "N"}),
        ]
        table = arrow.table([disp, force], schema=arrow.schema(fields, metadata={"sampling_rate": str(RATE)}))
        parquet.write_table(table, path, write_page_checksum=True)


def _write_uff(path: Path, disp: np.ndarray, force: np.ndarray) -> None:
    import pyuff

    path.unlink(missing_ok=True)
    file = pyuff.UFF(str(path))
    for name, values, kind in (("disp", disp, 8), ("force", force, 13)):
        entry = pyuff.prepare_58(
            binary=0,
            func_type=1,
            ver_num=1,
            load_case_id=0,
            rsp_node=1,
            rsp_dir=1,
            ref_node=1,
            ref_dir=1,
            data=values,
            x=np.arange(len(values)) / RATE,
            id1=name,
            rsp_ent_name="rig",
            ref_ent_name="rig",
            abscissa_spacing=1,
            abscissa_spec_data_type=17,
            ordinate_spec_data_type=kind,
            orddenom_spec_data_type=0,
            z_axis_spec_data_type=0,
            return_full_dict=True,
        )
        file.write_sets({key: value for key, value in entry.items() if value is not None}, "add")


def sources(kind: str) -> dict[str, Source]:
    """How the channels of each format are named."""
    if kind == "wav":
        return {"displacement": Source("1", "um", 32768 / 800), "force": Source("2", "N", 32768 / 500)}
    unit = {"uff": ("um", "N")}.get(kind, ("um", "N"))
    return {"displacement": Source("disp", unit[0]), "force": Source("force", unit[1])}


def stated_rate(kind: str) -> float | None:
    """The rate that the manifest must state, where the file does not."""
    return RATE if kind in ("mat", "mat73") else None
