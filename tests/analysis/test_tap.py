"""The tap test: blows found, modes found, sensors that are wrong told, and what holds no mode refused."""

import json

import numpy as np
import pytest

from testbed.analysis.tap.blows import find_blows
from testbed.analysis.tap.frequency_response import FrequencyResponse
from testbed.analysis.tap.tap import tap_test
from testbed.files.model_file import read_model
from testbed.files.taps_file import load_taps
from testbed.machine import Mode
from testbed.readers.frequency import response_unit
from testbed.units import UnitProblem
from tests.support.made_decays import rung
from tests.support.made_taps import B2, Hammer, blows, write_taps
from tests.support.real_data import MEASUREMENTS, needs
from tests.support.shell import Shell

pytest.importorskip("sdypy.EMA", reason="needs the extra package sdypy-EMA")
FAST = Hammer(blows=3, spacing=0.5)
OBLIQUE = (Mode(0.5, 500.0, 0.02, np.radians(20.0), "tool"), Mode(0.3, 800.0, 0.015, np.radians(-35.0), "tool"))
MACHINE = ((456.8, 0.0112, 0.35, 1.0), (516.5, 0.0246, 1.31, 0.7), (1448.9, 0.017, -0.61, 0.5))  # Hz, 1, rad, m/s^2
MEASURED = "folder: {folder}\nband: [300 Hz, 3000 Hz]\ntaps:\n  - {{file: {file}, direction: x, on: tool, {columns}}}\n"
COLUMNS = {
    "impact_Point1_time.txt": "time: {column: 1, unit: s}, force: {column: 2, unit: N}, response: {column: 3, unit: m/s^2}",
    "FRF_Point_1.txt": "frequency: {column: 1, unit: Hz}, real: {column: 2, unit: m/N}, imaginary: {column: 3, unit: m/N}"}


@pytest.fixture
def shell(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Shell(capsys)


def receptance(modes, frequency):
    """Receptance along x, m/N."""
    s = 2j * np.pi * frequency
    return sum(mode.shape[0] ** 2 / (mode.mass * (s**2 + 2 * mode.damping_ratio * mode.natural_frequency_rad * s
                                                  + mode.natural_frequency_rad**2)) for mode in modes)


def close(found, modes, frequency=1e-3):
    """Whether modes, lowest first, are found within 0.1 % in frequency, 2 % in damping and stiffness, and 1 degree."""
    true = sorted(modes, key=lambda mode: mode.natural_frequency)
    assert [mode.natural_frequency.value for mode in found.modes] == pytest.approx(
        [mode.natural_frequency for mode in true], rel=frequency)
    for one, mode in zip(found.modes, true, strict=True):
        assert one.damping_ratio.value == pytest.approx(mode.damping_ratio, rel=0.02)
        assert one.mode().stiffness == pytest.approx(mode.stiffness, rel=0.02)
        assert np.sin(one.direction.value - mode.direction) == pytest.approx(0.0, abs=np.radians(1.0))


def test_blows_in_x_and_y_give_the_machine(shell, tmp_path):
    write_taps(tmp_path, B2, hammer=FAST)
    (tmp_path / "cut.yaml").write_text(
        "structure: {mass: 1 kg, natural_frequency: 99 Hz, damping_ratio: 0.01}\ncutter: {flutes: 2, diameter: 12 mm}\n"
        "cutting: {immersion: 0.25, tangential_coefficient: 1319.4 N/mm^2, normal_coefficient: 788.8 N/mm^2}\n")
    found = shell.json("tap", "taps.yaml", "-m", "cut.yaml", "-o", "machine.yaml", "--report", "page")
    assert any("exchanged axes would not show" in note for note in found["notes"])
    assert len(found["modes"]) == 4 and len(found["blows"]) == 6 and all(one["used"] for one in found["blows"])
    close(tap_test(load_taps("taps.yaml")), B2)
    model = read_model("machine.yaml")
    assert [mode.on for mode in model.structure.modes] == ["tool"] * 4 and model.cutter.flutes == 2
    assert model.structure.modes[0].mass == pytest.approx(found["modes"][0]["mass"]["value"], rel=1e-12)
    page = (tmp_path / "page" / "report.html").read_text()
    assert "Do the modes explain the responses?" in page and "coherence" in page


def test_cross_responses_give_directions(tmp_path):
    close(tap_test(load_taps(write_taps(tmp_path, OBLIQUE, "xx xy", FAST))), OBLIQUE)


def test_a_sensor_turned_round_is_told(tmp_path):
    found = tap_test(load_taps(write_taps(tmp_path, OBLIQUE, "xx yy xy yx", FAST, signs={"xx": -1.0, "yx": -1.0})))
    assert any("turned round" in note and note.startswith("xx") for note in found.notes)
    close(found, OBLIQUE)


def test_exchanged_axes_are_told(tmp_path):
    path = write_taps(tmp_path, OBLIQUE, "xx yy xy yx", FAST)
    for one, other in (("xx", "xy"), ("yy", "yx")):
        (tmp_path / f"{one}.csv").rename(tmp_path / "spare.csv")
        (tmp_path / f"{other}.csv").rename(tmp_path / f"{one}.csv")
        (tmp_path / "spare.csv").rename(tmp_path / f"{other}.csv")
    found = tap_test(load_taps(path))
    assert any("exchanged" in note for note in found.notes)
    close(found, OBLIQUE)


def test_a_pair_three_per_cent_apart_is_two_modes(tmp_path):
    pair = (Mode(0.5, 700.0, 0.01, 0.0, "tool"), Mode(0.6, 719.0, 0.012, 0.0, "tool"))
    close(tap_test(load_taps(write_taps(tmp_path, pair, "xx", FAST))), pair)


def test_double_hits_and_overloads_are_left_out():
    force, response = blows(B2[:2], (1.0, 0.0), (1.0, 0.0), Hammer(blows=4, spacing=0.5), 1)
    second = round(0.57 * 25600)
    force[second : second + 8] += 0.3 * force.max()
    third = slice(round(1.04 * 25600), round(1.4 * 25600))
    response[third] = np.clip(response[third], -0.5 * response[third].max(), 0.5 * response[third].max())
    found = find_blows(force, response)
    assert [blow.left_out for blow in found] == ["", "it hit twice", "the response was overloaded", ""]


def _spectrum(folder, values, unit, header="f,re,im"):
    frequency = np.arange(0.0, 3000.0, 2.0)
    np.savetxt(folder / "f.csv", np.column_stack([frequency, *values(frequency)]), delimiter=",", header=header, comments="")
    return frequency, unit


@pytest.mark.parametrize(("unit", "factor", "order"), [("m/N", 1.0, 0), ("um/N", 1e6, 0), ("m/s/N", 1.0, 1),
                                                       ("g/N", 1 / 9.80665, 2), ("mm/kN", 1e6, 0)])
def test_a_frequency_response_of_any_quantity_is_the_same(unit, factor, order, tmp_path):
    def parts(frequency):
        noise = 1.0 + 1e-3 * np.random.default_rng(2).standard_normal((2, len(frequency))).T @ [1.0, 1j]
        values = receptance(B2[:2], frequency) * noise * (2j * np.pi * frequency) ** order * factor
        return values.real, values.imag

    _spectrum(tmp_path, parts, unit)
    (tmp_path / "taps.yaml").write_text(f"taps: [{{file: f.csv, direction: x, on: tool, frequency: {{column: f, unit: Hz}}, "
                                        f"real: {{column: re, unit: {unit}}}, imaginary: {{column: im, unit: {unit}}}}}]\n")
    close(tap_test(load_taps(tmp_path / "taps.yaml")), B2[:2])


def test_amplitude_and_phase_and_uff_are_read(tmp_path):
    pyuff = pytest.importorskip("pyuff")

    def parts(frequency):
        return np.abs(receptance(B2[:2], frequency)), np.degrees(np.angle(receptance(B2[:2], frequency)))

    frequency, _ = _spectrum(tmp_path, parts, "m/N", "f,a,p")
    accelerance = receptance(B2[:2], frequency) * -((2 * np.pi * frequency) ** 2)
    pyuff.UFF(str(tmp_path / "f.uff")).write_sets(pyuff.prepare_58(
        func_type=4, rsp_node=1, rsp_dir=1, ref_node=1, ref_dir=1, binary=0, ord_data_type=5, data=accelerance, x=frequency,
        num_pts=len(frequency), abscissa_spacing=1, abscissa_min=0.0, abscissa_inc=2.0, abscissa_spec_data_type=18,
        ordinate_spec_data_type=12, orddenom_spec_data_type=13, id1="tip"))
    table = ("{file: f.csv, direction: x, frequency: {column: f}, amplitude: {column: a, unit: m/N}, "
             "phase: {column: p, unit: deg}}")
    (tmp_path / "taps.yaml").write_text(f"taps: [{table}, {{file: f.uff, direction: x}}]\n")
    one, other = load_taps(tmp_path / "taps.yaml").taps
    assert np.allclose(one.spectrum.values, receptance(B2[:2], one.spectrum.frequency))
    assert np.allclose(other.spectrum.values, one.spectrum.values, rtol=1e-4)


def test_a_frf_table_says_its_columns_or_is_refused(shell, tmp_path):
    frequency = np.arange(2.0, 3000.0, 2.0)
    values = receptance(B2[:2], frequency)
    rows = [f"{one:14.6e}\t{value.real:14.12e}\t{value.imag:14.12e}\t" for one, value in zip(frequency, values, strict=True)]
    (tmp_path / "taps.yaml").write_text("taps: [{file: x.frf, direction: x, on: tool}]\n")
    (tmp_path / "x.frf").write_text("\n".join([rows[0] + "Freq\tHz\tReal\tm/N\tImag\tReal\t", *rows[1:]]) + "\n")
    (one,) = load_taps(tmp_path / "taps.yaml").taps
    assert np.allclose(one.spectrum.values[:100], receptance(B2[:2], one.spectrum.frequency[:100]), rtol=1e-9)
    assert "frequency, real and imaginary part in m/N" in one.notes[0]
    (tmp_path / "x.frf").write_text("\n".join(rows) + "\n")
    assert "does not say what its columns are" in shell.refused("tap", "taps.yaml", "-o", "m.yaml")
    assert not (tmp_path / "m.yaml").exists()


DECAYS = """sampling_rate: 25600 Hz
on: tool
taps:
  - {file: d.csv, direction: x, response: {column: ax, unit: m/s^2, quantity: acceleration}}
  - {file: d.csv, direction: -y, response: {column: ay, unit: m/s^2, quantity: acceleration}}
"""


def test_taps_without_force_give_modes_without_mass(shell, tmp_path):
    time, random = np.arange(40000) / 25600.0, np.random.default_rng(8)
    motion = sum(rung(MACHINE, time, start) for start in (0.1, 0.8)) + 2e-3 * random.standard_normal((2, 40000))
    np.savetxt(tmp_path / "d.csv", (motion * [[1.0], [-1.0]]).T, delimiter=",", header="ax,ay", comments="", fmt="%.7g")
    (tmp_path / "taps.yaml").write_text(DECAYS)
    found = shell.json("tap", "taps.yaml", "-o", "machine.yaml", "--report", "page")
    assert [one["natural_frequency"]["value"] for one in found["modes"]] == pytest.approx([456.8, 516.5, 1448.9], rel=1e-3)
    assert [one["direction"]["value"] for one in found["modes"]] == pytest.approx([0.35, 1.31, -0.61], abs=0.01)
    assert all(one["mass"]["value"] is None and not one["mass"]["determined"] for one in found["modes"])
    assert len(found["decays"]) == 2 and any("no force was measured, so the blows tell" in note for note in found["notes"])
    model = read_model("machine.yaml")
    assert model.not_determined == tuple(f"modes[{place}].mass" for place in range(3))
    assert model.tapped["modes[0].natural_frequency"][0] < 456.8 < model.tapped["modes[0].natural_frequency"][1]
    assert "What rings after each blow without force?" in (tmp_path / "page" / "report.html").read_text()
    (tmp_path / "base.yaml").write_text(
        "structure: {modes: [{mass: 3 kg, natural_frequency: 420 Hz, damping_ratio: 0.02, direction: x, on: tool}]}\n")
    shell.json("tap", "taps.yaml", "-m", "base.yaml", "-o", "other.yaml")
    assert [(mode.mass, round(mode.natural_frequency)) for mode in read_model("other.yaml").structure.modes] == [(3.0, 457)]
    np.savetxt(tmp_path / "d.csv", random.standard_normal((40000, 2)), delimiter=",", header="ax,ay", comments="", fmt="%.7g")
    assert "holds no mode" in shell.refused("tap", "taps.yaml", "-o", "none.yaml")


def test_a_uff_file_of_several_directions_says_its_own(tmp_path):
    pyuff = pytest.importorskip("pyuff")
    frequency = np.arange(0.0, 2000.0, 2.0)
    file = pyuff.UFF(str(tmp_path / "f.uff"))
    for number, (sensed, along) in enumerate(((1, 1), (-2, 1), (3, 1), (2, 2))):
        file.write_sets(pyuff.prepare_58(
            func_type=4, rsp_node=1, rsp_dir=sensed, ref_node=1, ref_dir=along, binary=0, ord_data_type=5,
            data=receptance(B2[:2], frequency), x=frequency, num_pts=len(frequency), abscissa_spacing=1, abscissa_min=0.0,
            abscissa_inc=2.0, abscissa_spec_data_type=18, ordinate_spec_data_type=8, orddenom_spec_data_type=13,
            id1=f"function {number}"), mode="add" if number else "overwrite")
    (tmp_path / "taps.yaml").write_text("taps: [{file: f.uff, direction: x}]\n")
    assert [(one.along, one.sensed) for one in load_taps(tmp_path / "taps.yaml").taps] == [
        ((1.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (0.0, -1.0)), ((0.0, 1.0), (0.0, 1.0))]


def test_windows_and_the_sensor_s_mass_are_undone(tmp_path):
    path = write_taps(tmp_path, B2[:2], "xx", Hammer(blows=1, spacing=0.5))
    table = np.loadtxt(tmp_path / "xx.csv", delimiter=",", skiprows=1)
    peak = int(np.argmax(table[:, 0]))
    table[:, 1] *= np.exp(-(np.arange(len(table)) - peak) / 25600.0 / 0.05)
    np.savetxt(tmp_path / "xx.csv", table, delimiter=",", header="F,a", comments="")
    path.write_text(path.read_text() + "exponential_window: 50 ms\n")
    close(tap_test(load_taps(path)), B2[:2], 3e-3)  # one blow, of which the window leaves little: its interval is 0.75 %
    mode = Mode(0.2, 800.0, 0.02, 0.0, "tool")
    loaded = Mode(0.21, 800.0 * np.sqrt(0.2 / 0.21), 0.02 * np.sqrt(0.2 / 0.21), 0.0, "tool")
    path = write_taps(tmp_path, [loaded], "xx", FAST)
    path.write_text(path.read_text() + "sensor_mass: 10 gram\n")
    close(tap_test(load_taps(path)), [mode])


def test_what_holds_no_mode_is_refused_in_a_line(shell, tmp_path):
    path = write_taps(tmp_path, B2, "xx", FAST)
    table = np.loadtxt(tmp_path / "xx.csv", delimiter=",", skiprows=1)

    def said(force, response, text=""):
        np.savetxt(tmp_path / "xx.csv", np.column_stack([force, response]), delimiter=",", header="F,a", comments="")
        path.write_text(text or path.read_text())
        return shell.refused("tap", "taps.yaml", "-o", "m.yaml")

    noise = np.random.default_rng(3).standard_normal(len(table))
    assert "holds no mode" in said(table[:, 0], noise)
    assert "holds no blow" in said(noise, table[:, 1])
    slow = path.read_text().replace("25600.0 Hz", "1280.0 Hz")
    assert "sampled too slowly" in said(table[::20, 0] * 0 + (np.arange(len(table[::20])) % 640 == 100), table[::20, 1], slow)


def test_mistakes_are_said_with_their_place(shell, tmp_path):
    write_taps(tmp_path, B2, "xx", FAST)
    good = (tmp_path / "taps.yaml").read_text()
    for old, new, words in (("direction: x", "direction: z", "write x, y"), ("unit: N", "unit: V", "not calibrated"),
                            ("xx.csv", "zz.csv", "no such file"), ("force:", "forse:", "did you mean force"),
                            ("unit: m/s^2, quantity: acceleration", "unit: m/s^2, quantity: speed", "is not known"),
                            ("on: tool", "band: [900 Hz, 300 Hz]", "does not rise")):
        (tmp_path / "taps.yaml").write_text(good.replace(old, new))
        assert words in shell.refused("tap", "taps.yaml")
    with pytest.raises(UnitProblem):
        response_unit("V/N")


@needs("tap_test")
def test_a_measured_tool_s_record_and_its_receptance_agree(shell, tmp_path):
    found = {}
    for file, columns in COLUMNS.items():
        (tmp_path / "taps.yaml").write_text(MEASURED.format(folder=json.dumps(str(MEASUREMENTS / "tap_test")), file=file,
                                                            columns=columns))
        found[file] = shell.json("tap", "taps.yaml")
    record, spectrum = found.values()
    assert max(record["residual"], spectrum["residual"]) < 0.09
    assert len(record["modes"]) == len(spectrum["modes"]) == 6
    for one, other in zip(record["modes"], spectrum["modes"], strict=True):
        for name in ("natural_frequency", "damping_ratio", "mass"):
            assert max(one[name]["low"], other[name]["low"]) < min(one[name]["high"], other[name]["high"]), name
    for hertz, kilograms in ((1067.0, 0.513), (1264.0, 1.9), (1989.0, 0.302)):
        mode = min(record["modes"], key=lambda mode: abs(mode["natural_frequency"]["value"] - hertz))
        assert mode["natural_frequency"]["value"] == pytest.approx(hertz, rel=2e-3)
        assert mode["mass"]["value"] == pytest.approx(kilograms, rel=0.05)


@needs("plate_hammer")
def test_a_measured_plate_s_sensor_faces_the_hammer(tmp_path):
    folder = json.dumps(str(MEASUREMENTS / "plate_hammer"))
    (tmp_path / "taps.yaml").write_text(
        f"folder: {folder}\ntaps: [{{file: impact_pt8.txt, direction: x, time: {{column: 1, unit: s}}, "
        "force: {column: 2, unit: N}, response: {file: accel_pt8.txt, column: 2, unit: m/s^2}}]\n")
    found = tap_test(load_taps(tmp_path / "taps.yaml"))
    assert any("turned round" in note for note in found.notes)
    assert found.modes[0].natural_frequency.value == pytest.approx(59.38, rel=2e-3)
    assert found.modes[0].damping_ratio.value == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize(("drift", "least", "most"), [(0.0, 0.0, 0.0), (3e-4, 15.0, 350.0)])
def test_the_drift_of_a_sensor_is_no_mode(drift, least, most):
    frequency = np.arange(1.0, 2000.0)
    held = receptance((Mode(0.5, 500.0, 0.02), Mode(0.3, 1200.0, 0.02)), frequency)
    one = FrequencyResponse("x", frequency, held + drift / frequency**2, (1.0, 0.0), (1.0, 0.0), "tool")
    assert least <= one.lowest <= most
    kept = one.from_lowest().believed(1.0, 1e6)
    assert kept[480:520].all() and kept[1180:1220].all()
