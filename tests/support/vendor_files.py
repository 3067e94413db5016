"""Files as measuring software writes them, made here with known contents: two channels, a hammer's force and the response.

`KINDS` names every kind; `KINDS[kind](Draw(seed, folder))` writes one and says what is in it.
"""

from __future__ import annotations

import inspect
import wave
from collections.abc import Callable

import h5py
import numpy as np
import scipy.io

from tests.support import vendor_text
from tests.support.vendor_draws import Draw, Made


def two_files(draw: Draw) -> Made:
    draw.file("force.txt", draw.rows_of(draw.force, time="%.6g"))
    made = draw.made(draw.file("acc.txt", draw.rows_of(draw.response, time="%.6e")), rate_error=2e-5)
    made.channels = {"time": {"column": 1, "unit": "s"}, "force": {"file": "force.txt", "column": 2, "unit": "N"},
                     "acceleration": {"column": 2, "unit": "m/s^2"}}  # fmt: skip
    return made


def two_files_of_two_rates(draw: Draw) -> Made:
    made = two_files(draw)
    draw.file("force.txt", "".join(f"{1.5 * t:.7f}\t{f:.9g}\n" for t, f in zip(draw.time, draw.force, strict=True)))
    made.force = made.response = None
    return made


def tdms(draw: Draw) -> Made:
    from nptdms import ChannelObject, TdmsWriter

    words = (("Newtons", "Volts"), ("N", "V"), ("newton", "volt"))[int(draw.random.integers(3))]
    name = str(draw.random.choice(["unit_string", "NI_UnitDescription"]))
    both = (("F", draw.force, words[0]), ("a", draw.response, words[1]))
    with TdmsWriter(str(draw.folder / "a.tdms")) as writer:
        writer.write_segment([ChannelObject("Log", label, values, {"wf_increment": 1 / draw.rate, name: unit})
                              for label, values, unit in both])  # fmt: skip
    return draw.made("a.tdms", unit="V", told="uncalibrated")


def _uff(draw: Draw, labels: tuple[str, str], over_frequency: bool) -> str:
    import pyuff

    axis = np.arange(draw.rows) * 0.5 if over_frequency else draw.time
    file = pyuff.UFF(str(draw.folder / "a.uff"))
    for number, (name, values, label) in enumerate((("F", draw.force, labels[0]), ("a", draw.response, labels[1])), 1):
        file._write_set({
            "type": 58, "binary": 0, "id1": name, "id2": "NONE", "id3": "NONE", "id4": "NONE", "id5": "NONE",
            "func_type": 4 if over_frequency else 1, "ver_num": 0, "load_case_id": 0, "rsp_ent_name": "NONE",
            "rsp_node": number,
            "rsp_dir": 1, "ref_ent_name": "NONE", "ref_node": 1, "ref_dir": 1, "ord_data_type": 6 if over_frequency else 4,
            "num_pts": draw.rows, "abscissa_spacing": 1, "abscissa_min": 0.0, "abscissa_inc": axis[1], "z_axis_value": 0.0,
            "abscissa_spec_data_type": 18 if over_frequency else 17, "abscissa_len_unit_exp": 0, "abscissa_force_unit_exp": 0,
            "abscissa_temp_unit_exp": 0, "abscissa_axis_units_lab": "s", "ordinate_spec_data_type": 13 if number == 1 else 12,
            "ordinate_axis_units_lab": label, "ordinate_len_unit_exp": 0, "ordinate_force_unit_exp": 0,
            "ordinate_temp_unit_exp": 0, "orddenom_spec_data_type": 0, "orddenom_axis_units_lab": "NONE",
            "orddenom_len_unit_exp": 0, "orddenom_force_unit_exp": 0, "orddenom_temp_unit_exp": 0,
            "z_axis_axis_units_lab": "NONE",
            "z_axis_spec_data_type": 0, "z_axis_len_unit_exp": 0, "z_axis_force_unit_exp": 0, "z_axis_temp_unit_exp": 0,
            "abscissa_axis_lab": "X", "ordinate_axis_lab": "Y", "orddenom_axis_lab": "NONE", "z_axis_axis_lab": "NONE",
            "x": axis, "data": values * (1 + 1j) if over_frequency else values}, "add")  # fmt: skip
    return "a.uff"


def uff_time(draw: Draw) -> Made:
    labels = (("N", "m/s^2"), ("Newtons", "m/s2"), ("NONE", "NONE"))[int(draw.random.integers(3))]
    return draw.made(_uff(draw, labels, over_frequency=False))


def uff_frequency_response(draw: Draw) -> Made:
    return Made(
        _uff(draw, ("N", "m/s^2"), over_frequency=True),
        {"force": {"column": "F re"}, "acceleration": {"column": "a"}},
        None,
        None,
        1,
    )


def text_frequency_response(draw: Draw) -> Made:
    head = str(
        draw.random.choice(["Frequency [Hz]\tReal [m/N]\tImag [m/N]\n", "freq\tRe\tIm\n", "f (Hz)\tmagnitude\tphase (deg)\n"])
    )
    rows = "".join(
        f"{number * 0.5:.1f}\t{f:.6e}\t{a:.6e}\n" for number, (f, a) in enumerate(zip(draw.force, draw.response, strict=True))
    )
    return Made(
        draw.file("frf.txt", head + rows),
        {"force": {"column": 2, "unit": "N"}, "acceleration": {"column": 3, "unit": "m/s^2"}},
        None,
        None,
        1,
    )


def sensitivity(draw: Draw) -> Made:
    unit = str(draw.random.choice(["mV/g", "mV/(m/s^2)", "pC/g", "dB"]))
    return Made(draw.file("a.csv", f"t [s],F [N],a [{unit}]\n" + draw.rows_of(draw.force, draw.response, sep=",")),
                {"force": {"column": "F"}, "acceleration": {"column": "a"}}, None, None, 1)  # fmt: skip


def wav(draw: Draw) -> Made:
    bits = int(draw.random.choice([16, 24, 32]))
    full = np.column_stack([draw.force / 100, draw.response / 50])
    counts = np.round(full * (2 ** (bits - 1) - 1)).astype("<i4")
    with wave.open(str(draw.folder / "a.wav"), "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(bits // 8)
        file.setframerate(int(draw.rate))
        file.writeframes(counts.view("u1").reshape(-1, 4)[:, : bits // 8].tobytes())
    made = draw.made("a.wav")
    made.force, made.response = (counts * [100.0, 50.0] / 2.0 ** (bits - 1)).T  # rounded to the converter's steps
    made.channels = {
        "force": {"column": 1, "unit": "N", "scale": 100},
        "acceleration": {"column": 2, "unit": "m/s^2", "scale": 50},
    }
    return made


def matlab(draw: Draw) -> Made:
    data = np.column_stack([draw.time, draw.force, draw.response])
    scipy.io.savemat(draw.folder / "a.mat", {"run": {"signals": data, "fs": draw.rate}})
    made = draw.made("a.mat", more={"key": "run.signals"})
    made.channels = {
        "time": {"column": 1, "unit": "s"},
        "force": {"column": 2, "unit": "N"},
        "acceleration": {"column": 3, "unit": "m/s^2"},
    }
    return made


def hdf5(draw: Draw) -> Made:
    with h5py.File(draw.folder / "a.h5", "w") as file:
        for name, values, unit in (("F", draw.force, "Newtons"), ("a", draw.response, "m s^-2")):
            file.create_dataset(f"log/{name}", data=values).attrs["units"] = unit
        file["log"].attrs["fs"] = draw.rate
        for number in range(40):
            file.create_dataset(f"settings/{number}", data=np.arange(3.0))
    return draw.made("a.h5")


def _kinds(module) -> dict[str, Callable[[Draw], Made]]:
    named = inspect.getmembers(module, inspect.isfunction)
    return {name: maker for name, maker in named if not name.startswith("_") and maker.__module__ == module.__name__}


KINDS = _kinds(vendor_text) | {maker.__name__: maker for maker in (
    two_files, two_files_of_two_rates, tdms, uff_time, uff_frequency_response, text_frequency_response, sensitivity, wav,
    matlab, hdf5)}  # fmt: skip
