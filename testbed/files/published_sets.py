"""Campaigns for published measurements: which of a set's files holds what, in which column and unit, cut how.

Facts of layout and conditions alone, as their makers state them or as they were found by looking; the files a user downloads.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from testbed.files.starter import quoted
from testbed.problem import InputProblem


@dataclass(frozen=True)
class PublishedSet:
    """One set. about: what it is, a line; head: the campaign's first lines; records: (a file's name, one * in it standing for
    anything; what its records say beside the file, {*} being what the * stood for; nothing where another record names it)."""

    about: str
    head: str
    records: tuple[tuple[str, tuple[str, ...]], ...]

    def said_of(self, name: str) -> tuple[str, ...] | None:
        """What the records of a file say, empty for one that another names; None where it is none of the set's."""
        for known, said in self.records:
            if match := re.fullmatch(re.escape(known).replace(r"\*", "(.+)"), name, re.IGNORECASE):
                return tuple(one.replace("{*}", match[match.re.groups]) for one in said)
        return None


_DEPTHS = {"22": 12, "26": 4, "30": 8}  # mm, of the titanium cuts by their number
SETS = {
    "silverbox": PublishedSet(
        "an electronic oscillator with a cubic spring, volts in and out (Wigren and Schoukens, 2013)",
        "sampling_rate: 610.3515625 Hz     # 1e7 / 2^14\n"
        "channels:\n  force: {column: V1, unit: V}\n  displacement: {column: V2, unit: V}\n",
        (("SNLS80mV.csv", ("name: arrow, kind: excited, to: 66.6 s", "name: multisine, kind: excited, from: 66.6 s")),
         ("Schroeder80mV.csv", ("name: schroeder, kind: excited",)))),
    "milling-force": PublishedSet(
        "dynamometer forces of slots, 6000 rpm, 3 mm deep, two teeth; the feed is along the dynamometer's y",
        "spindle_speed: 6000 rpm\ndepth_of_cut: 3 mm\nflutes: 2\n"
        "channels:\n  force_x: {column: Fy, unit: N}\n  force_y: {column: Fx, unit: N}\n",
        (("6-n6000f*ap3ae25.csv", ("kind: cut, feed: {*} mm/min",)),)),
    "tap-test": PublishedSet(
        "an instrumented hammer on a tool in its holder, 51.2 kHz",
        "channels:\n  time: {column: 1, unit: s}\n  force: {column: 2, unit: N}\n  acceleration: {column: 3, unit: m/s^2}\n",
        tuple((name, ("kind: excited",)) for name in ("impact_Point1_time.txt", "Point1_Channel1_CH1.txt"))),
    "milling-chatter": PublishedSet(
        "one slot growing into chatter; the unit is not stated, and the nominal speed is not to be trusted",
        "sampling_rate: 10 kHz     # every sample is stored twice\n"
        "channels:\n  acceleration: {column: data, unit: arbitrary}\n",
        (("data.mat", ("kind: cut, spindle_speed: 5000 rpm, depth_of_cut: 2.6 mm, feed: 1250 mm/min, flutes: 4",)),)),
    "titanium-milling": PublishedSet(
        "cuts of Ti6Al4V at 2600 rpm (Chen, Li, Hou and Bu, 2019); the one 12 mm deep chatters; the unit is not stated",
        "spindle_speed: 2600 rpm\nfeed: 0.1 mm/tooth\n"
        "channels:\n  time: {column: Accelerationstdy_1, unit: s}\n"
        "  acceleration_x: {column: Accelerationstdy_2, unit: arbitrary}\n"
        "  acceleration_y: {column: Accelerationstdy_3, unit: arbitrary}\n",
        tuple((f"{before}{number}.mat", (f"kind: cut, depth_of_cut: {depth} mm",))
              for before in ("", "test_") for number, depth in _DEPTHS.items())),
    "plate-hammer": PublishedSet(
        "a hammer on a plate, force and acceleration in two files; the accelerometer faces against the hammer",
        "channels:\n  time: {column: 1, unit: s}\n  acceleration: {column: 2, unit: m/s^2}\n  force: {column: 2, unit: N}\n",
        (("accel_pt*.txt", ("kind: excited, channels: {force: {file: {folder}impact_pt{*}.txt}}",)),
         ("impact_pt*.txt", ()))),
}


def published_campaign(name: str, files: Sequence[str], folder: Path) -> str:
    """campaign.yaml, to stand in a folder, of a set's files. InputProblem where one of them is none of the set's."""
    found = SETS[name]
    lines = []
    for file in files:
        path = Path(file)
        said = found.said_of(path.name)
        if said is None:
            known = ", ".join(known for known, _ in found.records)
            raise InputProblem(file, f"is no file of the set {name}", f"its files are called {known}")
        if not path.is_file():
            raise InputProblem(file, "no such file", "give the files that you downloaded")
        whole = path.resolve()
        shown = whole.relative_to(folder.resolve()) if whole.is_relative_to(folder.resolve()) else whole
        beside = "" if shown.parent == Path() else f"{shown.parent.as_posix()}/"
        lines += [f"  - {{file: {quoted(shown.as_posix())}, {one.replace('{folder}', beside)}}}" for one in said]
    if not lines:
        raise InputProblem(files[0] if files else name, "is no record by itself", "give the files of records, too")
    return f"# {found.about}\nname: {name}\n{found.head}records:\n" + "\n".join(lines) + "\n"
