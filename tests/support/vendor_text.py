"""Text files as measuring software writes them, with known contents; the forms follow LabVIEW, DynoWare, catman, DEWESoft,
Testlab, PicoScope, oscilloscopes, MATLAB and Excel."""

from __future__ import annotations

from tests.support.vendor_draws import GRAVITY, Draw, Made


def _lvm(draw: Draw, columns: str, units: tuple[str, str], samples: int, separator: str = "\t") -> str:
    head = ("LabVIEW Measurement", "Writer_Version\t2", "Reader_Version\t2", "Separator\tTab", "Decimal_Separator\t.",
            f"Multi_Headings\t{'Yes' if columns == 'Multi' else 'No'}", f"X_Columns\t{columns}", "Time_Pref\tRelative",
            "***End_of_Header***\t", "\t")  # fmt: skip
    return "\n".join(head) + "\n" + _segment(draw, columns, units, samples)


def _segment(draw: Draw, columns: str, units: tuple[str, str], samples: int) -> str:
    gap = "\t\t" if columns == "Multi" else "\t"
    facts = [("Samples", samples, samples), ("Date", "2020/01/01", "2020/01/01"), ("Y_Unit_Label", *units),
             ("X_Dimension", "Time", "Time"), ("X0", 0, 0), ("Delta_X", *[f"{1 / draw.rate:.6E}"] * 2)]  # fmt: skip
    names = ["X_Value", "Hammer (Trigger)", "Sensor (Trigger)", "Comment"]
    if columns == "Multi":
        names.insert(2, "X_Value")
    return "".join(["Channels\t2\n", *(f"{name}\t{one}{gap}{two}\n" for name, one, two in facts), "***End_of_Header***\t\t\n",
                    "\t".join(names) + "\n"])  # fmt: skip


def _plain_rows(draw: Draw) -> str:
    return "".join(f"\t{force:.9g}\t{response:.9g}\n" for force, response in zip(draw.force, draw.response, strict=True))


def _labview(draw: Draw, **more) -> Made:
    return draw.made(draw.file("record.lvm", more.pop("text")), "Hammer (Trigger)", "Sensor (Trigger)", **more)


def lvm_unit_words(draw: Draw) -> Made:
    units = draw.random.choice([("Newtons", "m/s^2"), ("newton", "m/s2"), ("N", "meters/sec^2")])
    return _labview(draw, text=_lvm(draw, "No", tuple(units), draw.rows) + _plain_rows(draw), rate_error=1e-5)


def lvm_x_column_decimal_comma(draw: Draw) -> Made:
    text = (_lvm(draw, "One", ("N", "m/s^2"), draw.rows) + draw.rows_of(draw.force, draw.response)).replace(".", ",")
    return _labview(draw, text=text)


def lvm_x_columns_multi(draw: Draw) -> Made:
    rows = "".join(
        f"{t:.6f}\t{f:.9g}\t{t:.6f}\t{a:.9g}\n" for t, f, a in zip(draw.time, draw.force, draw.response, strict=True)
    )
    return _labview(draw, text=_lvm(draw, "Multi", ("N", "m/s^2"), draw.rows) + rows, rate_error=1e-5)


def lvm_two_captures(draw: Draw) -> Made:
    text = _lvm(draw, "No", ("N", "m/s^2"), draw.rows) + _plain_rows(draw) * 2
    return _labview(draw, text=text, told="2 captures", rate_error=1e-5)


def lvm_two_headers(draw: Draw) -> Made:
    first = _plain_rows(Draw(int(draw.random.integers(1, 999)), draw.folder))
    text = _lvm(draw, "No", ("N", "m/s^2"), first.count("\n")) + first + "\n" + _segment(draw, "No", ("N", "m/s^2"), draw.rows)
    return _labview(draw, text=text + _plain_rows(draw), told="2 captures", more={"key": 2}, rate_error=1e-5)


def dynoware(draw: Draw) -> Made:
    head = f"DynoWare,Version 2.5.1.2\nPath:,C:\\data\nFilename:,a.dwd\nDate:, \nSampling rate [Hz]:,{draw.rate:g}\nCycles:,1\n"
    return draw.made(draw.file("a.csv", head + "Time,F,a\ns,N,m/s^2\n" + draw.rows_of(draw.force, draw.response, sep=",")))


def dewesoft(draw: Draw) -> Made:
    unit, factor = [("g", GRAVITY), ("m/s2", 1.0)][int(draw.random.integers(2))]
    head = f"File name: D:\\tap.dxd\nSample rate: {draw.rate:g}\n\nTime (s)\tHammer/F (N)\tTool/a ({unit})\n"
    made = draw.made(draw.file("a.txt", head + draw.rows_of(draw.force, draw.response)), "Hammer/F", "Tool/a")
    made.response = draw.response * factor
    return made


def catman_german(draw: Draw) -> Made:
    head = "HBM_CATMAN_ASCII\r\nErstellt: 01.02.2020\r\nZeit [s]\tKraft [N]\tBeschleunigung [m/s²]\r\n"
    text = head + draw.rows_of(draw.force, draw.response, end="\r\n").replace(".", ",")
    encoding = str(draw.random.choice(["cp1252", "utf-16", "utf-8-sig"]))
    return draw.made(draw.file("a.asc", text, encoding), "Kraft", "Beschleunigung")


def din_units(draw: Draw) -> Made:
    head = str(draw.random.choice(["Zeit / s;Kraft / N;Beschl. / m/s²\n", '"Zeit, s";"Kraft, N";"Beschl., m/s²"\n']))
    return draw.made(draw.file("a.csv", head + draw.rows_of(draw.force, draw.response, sep=";").replace(".", ",")), "Kraft", 3)


def testlab_unit_row(draw: Draw) -> Made:
    head = 'Test section: "tap"\nPoint\tTool:1:+X\n"Time"\t"F"\t"a"\n"s"\t"N"\t"m/s2"\n'
    return draw.made(draw.file("a.txt", head + draw.rows_of(draw.force, draw.response)))


def units_in_brackets_row(draw: Draw) -> Made:
    row = str(draw.random.choice(["[s],[N],[m/s^2]\n", "(s),(Newtons),(m/s²)\n", "sec,Newtons,m/s/s\n"]))
    return draw.made(draw.file("a.csv", "t,F,a\n" + row + draw.rows_of(draw.force, draw.response, sep=",")))


def matlab_table_suffixes(draw: Draw) -> Made:
    made = draw.made(
        draw.file("a.csv", "time_s,force_N,acc_g\n" + draw.rows_of(draw.force, draw.response, sep=",")), "force_N", "acc_g"
    )
    made.response, made.told = draw.response * GRAVITY, "was read from the column's name"
    return made


def excel_semicolons(draw: Draw) -> Made:
    body = draw.rows_of(draw.force, draw.response, sep=";", tail=";", end="\r\n").replace(".", ",")
    head = str(draw.random.choice(["sep=;\r\n", ""])) + '"Time [s]";"F [N]";"a [m/s^2]";\r\n'
    return draw.made(draw.file("a.csv", head + body, "utf-8-sig" if head[0] == '"' else "utf-8"))


def quoted_decimal_commas(draw: Draw) -> Made:
    rows = "".join(f'"{t:.9f}","{f:.6f}","{a:.6f}"\n' for t, f, a in zip(draw.time, draw.force, draw.response, strict=True))
    return draw.made(draw.file("a.csv", '"Time (s)","F (N)","a (m/s^2)"\n' + rows.replace(".", ",")))


def few_digits(draw: Draw) -> Made:
    form = str(draw.random.choice(["%.2E", "%.3E", "%.4g", "%.3f", "%.4e"]))
    made = draw.made(draw.file("a.txt", draw.rows_of(draw.force, draw.response, time=form)), 2, 3, rate_error=4e-3)
    made.channels = {
        "force": {"column": 2, "unit": "N"},
        "acceleration": {"column": 3, "unit": "m/s^2"},
        "time": {"column": 1, "unit": "s"},
    }
    return made


def narrow_cells(draw: Draw) -> Made:
    rows = "".join(
        f"{(f'{t:.2E}' if t < 0.1 else f'{t:.6g}')}\t{f:.9g}\t{a:.9g}\n"
        for t, f, a in zip(draw.time, draw.force, draw.response, strict=True)
    )
    return draw.made(draw.file("a.txt", "Time\tF [N]\ta [m/s^2]\n" + rows), rate_error=2e-4)


def clock_times(draw: Draw) -> Made:
    milli = draw.rate == 1000.0
    rows, day = [], draw.random.choice(["", "2020-01-31 ", "31.01.2020 "])
    for t, f, a in zip(draw.time + 36000.5, draw.force, draw.response, strict=True):
        minute, second = divmod(t, 60.0)
        stamp = f"{day}{int(minute // 60):02d}:{int(minute % 60):02d}:{second:0{6 if milli else 9}.{3 if milli else 6}f}"
        rows.append(f"{stamp};{f:.9g};{a:.9g}\n")
    return draw.made(draw.file("a.csv", "Timestamp;F [N];a [m/s^2]\n" + "".join(rows)), rate_error=1e-4)


def fortran(draw: Draw) -> Made:
    rows = "".join(f"{t:18.9E}{f:18.9E}{a:18.9E}\n" for t, f, a in zip(draw.time, draw.force, draw.response, strict=True))
    return draw.made(draw.file("fort.dat", "     TIME (S)        F (N)        A (M/S2)\n" + rows.replace("E", "D")), "F", "A")


def fixed_width_spaces(draw: Draw) -> Made:
    rows = "".join(f"{t:14.9f}{f:16.6f}{a:16.6f}\n" for t, f, a in zip(draw.time, draw.force, draw.response, strict=True))
    return draw.made(
        draw.file("a.prn", "  Elapsed Time (s)   Hammer Force (N)   Tool Acc (m/s^2)\n" + rows), "Hammer Force", "Tool Acc"
    )


def one_column(draw: Draw) -> Made:
    head = str(draw.random.choice(["x [um]\n", "x (µm)\n", "Displacement (microns)\n", '"x, um"\n']))
    made = draw.made(draw.file("a.txt", head + "".join(f"{value:.9g}\n" for value in draw.response)))
    made.channels, made.unit = {"displacement": {"column": 1}}, "m"
    made.force, made.response, made.more = (
        None,
        draw.response * 1e-6,
        {"sampling_rate": f"{draw.rate!r} Hz", "kind": "ring-down"},
    )
    return made


def comments(draw: Draw) -> Made:
    sign = str(draw.random.choice(["#", "%", "//"]))
    rows = draw.rows_of(draw.force, draw.response, sep=" ").splitlines(keepends=True)
    rows.insert(len(rows) // 2, f"{sign} second half\n")
    head = f"{sign} hammer test\n{sign} fs = {draw.rate:g}\n{sign} t[s] F[N] a[m/s^2]\n"
    return draw.made(draw.file("a.dat", head + "".join(rows) + f"{sign} end\n"))


def oscilloscope(draw: Draw) -> Made:
    head = f"Model,TPS2024\nFirmware,3.1\nSample Interval,{1 / draw.rate:.6e},s\nRecord Length,{draw.rows}\n\nTIME,CH1,CH2\n"
    made = draw.made(draw.file("a.csv", head + draw.rows_of(draw.force, draw.response, sep=",")))
    made.channels = {"force": {"column": "CH1", "unit": "V"}, "acceleration": {"column": "CH2", "unit": "Volts", "scale": 1}}
    made.unit, made.told = "V", "uncalibrated"
    return made


def unit_row_of_words(draw: Draw) -> Made:
    text = "X,CH1,CH2,\nSecond,Volt,Volt,\n" + draw.rows_of(draw.force, draw.response, sep=",", tail=",")
    made = draw.made(draw.file("a.csv", text), "CH1", "CH2", unit="V", told="uncalibrated")
    made.channels["time"] = {"column": "X"}
    return made


def picoscope(draw: Draw) -> Made:
    rows = "".join(
        f"{1e3 * t:.8f},{1e3 * f:.6f},{a:.6f}\n" for t, f, a in zip(draw.time, draw.force, draw.response, strict=True)
    )
    text = "Time,Channel A,Channel B\n(ms),(mV),(V)\n\n" + rows
    return draw.made(draw.file("a.csv", text), "Channel A", "Channel B", unit="V", told="uncalibrated")


def paired_times(draw: Draw) -> Made:
    rows = "".join(f"{t:.9f},{f:.9g},{t:.9f},{a:.9g}\n" for t, f, a in zip(draw.time, draw.force, draw.response, strict=True))
    return draw.made(draw.file("a.csv", "Time1 [s],F [N],Time2 [s],a [m/s^2]\n" + rows))


def capitals(draw: Draw) -> Made:
    each = zip(draw.time, draw.force, draw.response, strict=True)
    rows = "".join(f"{1e3 * t:.9f},{1e-3 * f:.9f},{a:.9g}\n" for t, f, a in each)
    return draw.made(draw.file("A.CSV", "TIME (MS),FORCE (KN),ACC (M/S2)\n" + rows), "FORCE", "ACC")


def index_and_rate(draw: Draw) -> Made:
    rows = "".join(f"{number},{f:.9g},{a:.9g}\n" for number, (f, a) in enumerate(zip(draw.force, draw.response, strict=True)))
    return draw.made(draw.file("a.csv", f"Sample rate (Hz),{draw.rate:g}\nIndex,F (N),a (m/s^2)\n" + rows))


def brackets_no_unit(draw: Draw) -> Made:
    made = draw.made(
        draw.file("a.csv", "Time (s),Response (Trigger),Force (Ref)\n" + draw.rows_of(draw.response, draw.force, sep=","))
    )
    made.channels = {"force": {"column": "Force (Ref)", "unit": "N"}, "acceleration": {"column": "Response", "unit": "m/s^2"}}
    return made


def _numeric_units(draw: Draw, force: tuple[str, float], response: tuple[str, float]) -> Made:
    text = f"Time [s]\tF [{force[0]}]\ta [{response[0]}]\n" + draw.rows_of(draw.force, draw.response)
    made = draw.made(draw.file("a.txt", text))
    made.force, made.response = draw.force * force[1], draw.response * response[1]
    return made


def units_of_all_makers(draw: Draw) -> Made:
    forces = (
        ("Pounds", 4.4482216152605),
        ("lbf", 4.4482216152605),
        ("kN", 1e3),
        ("daN", 10.0),
        ("kgf", GRAVITY),
        ("Newton", 1.0),
    )
    responses = (
        ("g's", GRAVITY),
        ("G", GRAVITY),
        ("mm/s²", 1e-3),
        ("in/s^2", 0.0254),
        ("ft/s^2", 0.3048),
        ("m·s⁻²", 1.0),
        ("mg", GRAVITY * 1e-3),
    )
    return _numeric_units(
        draw, forces[int(draw.random.integers(len(forces)))], responses[int(draw.random.integers(len(responses)))]
    )
