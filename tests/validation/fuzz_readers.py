"""Damaged files: every format, mutated at random, must give the right numbers, a warning or one line of error.

As a script it prints a table: python tests/validation/fuzz_readers.py [MUTATIONS]. Outcomes: refused (InputProblem),
right (all numbers as in the sound file), short (a part of them, in order), warned (other numbers, and a note that the
sound file does not cause), within (other numbers without a note, but off by less than 3 standard deviations of the
channel's own noise, as noise itself is among so many samples), silent (other numbers by more than that without a note), and the
two that may not happen: crashed and hung.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parents[2])]

from testbed.problem import InputProblem  # noqa: E402
from testbed.readers import read_table  # noqa: E402
from testbed.readers.assemble import assemble  # noqa: E402
from testbed.recording import Recording  # noqa: E402
from tests.support.made_files import FORMATS, sources, stated_rate, write  # noqa: E402
from tests.validation.claims import Claim, Section  # noqa: E402

TEXT = ("csv", "tsv", "dynoware", "labview", "uff")
OUTCOMES = ("refused", "right", "short", "warned", "within", "silent", "crashed", "hung")
SMALL = 0.06  # of a channel's range: what one flipped bit may change and nobody can see
NOISE = 3.0  # standard deviations: 99.7 % of the noise stays below
SLOW = 5.0  # s; a small file that takes longer counts as hung


def read(kind: str, path: Path) -> tuple[Recording, tuple[str, ...]]:
    """A file of one of the made formats, as a campaign would read it."""
    return assemble(read_table(path), sources(kind), sampling_rate=stated_rate(kind))


def mutate(raw: bytes, random: np.random.Generator, text: bool) -> bytes:
    """One damage: flipped bits, a cut, a hole, a doubled or foreign piece; in text also fields and lines."""
    size = len(raw)
    data = bytearray(raw)
    choice = int(random.integers(0, 12 if text else 7))
    place = int(random.integers(0, size))
    length = int(random.integers(1, max(2, size // 20)))
    if choice == 0:
        data[place] ^= 1 << int(random.integers(0, 8))
    elif choice == 1:
        for spot in random.integers(0, size, 20):
            data[spot] = int(random.integers(0, 256))
    elif choice == 2:
        del data[place:]
    elif choice == 3:
        del data[place : place + length]
    elif choice == 4:
        data[place : place + length] = bytes(len(data[place : place + length]))
    elif choice == 5:
        data[place:place] = data[place : place + length]
    elif choice == 6:
        data[place:place] = random.bytes(length)
    else:
        return _mutate_text(raw, random, choice)
    return bytes(data)


def _mutate_text(raw: bytes, random: np.random.Generator, choice: int) -> bytes:
    wide = raw.startswith(b"\xff\xfe")
    lines = (raw.decode("utf-16") if wide else raw.decode("utf-8", "replace")).splitlines(keepends=True)
    place = int(random.integers(0, len(lines)))
    if choice == 7:
        del lines[place]
    elif choice == 8:
        lines.insert(place, lines[int(random.integers(0, len(lines)))])
    elif choice == 9:
        fields = lines[place].replace("\t", ",").split(",")
        lines[place] = lines[place].replace(fields[int(random.integers(0, len(fields)))], "OVL", 1)
    elif choice == 10:
        lines[place] = lines[place].replace(",", ";")
    else:
        other = int(random.integers(0, len(lines)))
        lines[place], lines[other] = lines[other], lines[place]
    text = "".join(lines)
    return text.encode("utf-16") if wide else text.encode("utf-8")


def noise(values: np.ndarray) -> float:
    """Standard deviation of white noise on a smooth signal, from the median of its sixth differences."""
    return float(1.4826 * np.median(np.abs(np.diff(values, 6))) / np.sqrt(924))


def outcome(kind: str, path: Path, sound: Recording, usual: tuple[str, ...]) -> str:
    """What a damaged file gives."""
    started = time.perf_counter()
    try:
        recording, notes = read(kind, path)
    except InputProblem as problem:
        return "hung" if time.perf_counter() - started > SLOW else "refused" if "\n" not in str(problem) else "crashed"
    except Exception as error:  # what this is all about
        return f"crashed ({type(error).__name__}: {error})"
    if time.perf_counter() - started > SLOW:
        return "hung"
    if recording.sampling_rate == sound.sampling_rate and set(recording.channels) == set(sound.channels):
        worst, noisy = 0.0, 0.0
        late = max(0, round((recording.start - sound.start) * sound.sampling_rate))  # where the first rows are gone
        for name, whole in sound.channels.items():
            values = whole[late:] if late < len(whole) else whole
            rows = min(len(values), len(recording))
            off = float(np.abs(recording.channels[name][:rows] - values[:rows]).max())
            worst, noisy = max(worst, off / float(np.ptp(whole))), max(noisy, off / noise(whole))
        if worst < 1e-3:
            return "right" if len(recording) == len(sound) else "short"
        if not set(notes) - set(usual):
            if noisy < NOISE:
                return "within"
            return "silent" if worst <= SMALL else f"silent ({worst:.2f} of the range)"
    return "warned" if set(notes) - set(usual) else "silent (another rate or other channels)"


def fuzz(kind: str, mutations: int, folder: Path, seed: int = 1) -> tuple[Counter[str], list[str]]:
    """Outcomes of many mutations of one format, and what crashed or hung."""
    path = write(kind, folder)
    raw = path.read_bytes()
    sound, usual = read(kind, path)
    random = np.random.default_rng([seed, FORMATS.index(kind)])
    counted: Counter[str] = Counter()
    faults = []
    for number in range(mutations):
        damaged = mutate(raw, random, kind in TEXT)
        if damaged == raw:
            continue
        path.write_bytes(damaged)
        found = outcome(kind, path, sound, usual)
        counted[found.split(" ")[0]] += 1
        counted["plain"] += found.startswith("silent (")
        if found.startswith(("crashed", "hung")):
            faults.append(f"{kind} mutation {number}: {found}")
    return counted, faults


def check(mutations: int = 300) -> Section:
    """The table, and the two claims: nothing crashes, nothing hangs."""
    rows, faults, plain = [], [], 0
    for kind in FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            counted, found = fuzz(kind, mutations, Path(folder))
        faults += found
        rows.append((kind, *(str(counted[name]) for name in OUTCOMES)))
        plain += counted["plain"]
    silent = sum(int(row[1 + OUTCOMES.index("silent")]) for row in rows)
    within = sum(int(row[1 + OUTCOMES.index("within")]) for row in rows)
    total = mutations * len(rows)
    claims = (
        Claim("damaged files that crash a reader or hang it", "0", str(len(faults)), not faults),
        Claim("damaged files read as other numbers without a warning", "0", f"{silent} of {total}", silent == 0,
              f"formats without checksums; off by more than {NOISE:g} standard deviations of the noise"),
        Claim("damaged files changed by less than the record's own noise, without a warning", "-", f"{within} of {total}", None,
              f"off by less than {NOISE:g} standard deviations of it: among so many samples noise does that, too"),
        Claim(f"of these, off by more than {SMALL:.0%} of a channel's range", "0", str(plain), plain == 0),
    )
    head = ("format", *OUTCOMES)
    return Section(f"Damaged files ({mutations} mutations a format)", claims, (("Outcomes", head, tuple(rows)),))


def main(mutations: int = 300) -> int:
    """Print the table; exit code 1 where anything crashed or hung."""
    print("format    " + "".join(f"{name:>9}" for name in OUTCOMES))
    everything: list[str] = []
    for kind in FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            counted, faults = fuzz(kind, mutations, Path(folder))
        everything += faults
        print(f"{kind:10}" + "".join(f"{counted[name]:9d}" for name in OUTCOMES), flush=True)
    print("\n".join(everything))
    return 1 if everything else 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:2])))
