"""Small measured-looking files, written as a campaign's manifest asks for them: its columns, its delimiter, its format."""

import csv

import numpy as np
import scipy.io
import scipy.io.wavfile

from testbed.units import parse_quantity, unit_named

RATE = 12800.0


def channels_of(data, record):
    """The channels of a record, the campaign's overridden key by key."""
    found = dict(data.get("channels", {}))
    for name, own in record.get("channels", {}).items():
        common = found.get(name, {})
        found[name] = own if "none" in (own, common) else {**common, **own}
    return found


def _files(data, record):
    """The file of every channel of a record."""
    return {channel: one.get("file", record["file"]) if one != "none" else record["file"]
            for channel, one in channels_of(data, record).items()}


def write_records(data, folder):
    """Write every file that a campaign names, with the columns that its records ask for."""
    place = folder / data.get("folder", "")
    place.mkdir(parents=True, exist_ok=True)
    for name in {file for record in data["records"] for file in _files(data, record).values()}:
        records = [record for record in data["records"] if name in _files(data, record).values()]
        wanted = {}
        for number, record in enumerate(data["records"]):
            files = _files(data, record)
            wanted |= {channel: (one, number) for channel, one in channels_of(data, record).items()
                       if (files[channel] == name or channel == "time" and name in files.values())
                       and (channel not in wanted or wanted[channel][0] == "none")}
        shared = data | {key: value for record in records for key, value in record.items()}
        _write(place / name, wanted, shared, 1.6 if any({"from", "to"} & set(record) for record in records) else 0.25)


def _write(path, wanted, shared, seconds):
    rate = parse_quantity(shared.get("sampling_rate", f"{RATE} Hz"), "Hz")
    t = np.arange(round(seconds * rate)) / rate
    columns = {}
    for channel, (entry, seed) in wanted.items():
        if entry == "none":
            if channel == "time":
                columns["time"] = np.round(np.sqrt(t), 4)  # called time, and none
            continue
        columns[entry.get("column", channel)] = _signal(channel, entry, t, shared, seed)
    if path.suffix == ".mat":
        keys = [entry.get("key") for entry, _ in wanted.values() if entry != "none"]
        outer, _, inner = (shared.get("key") or next(key for key in keys if key)).partition(".")
        scipy.io.savemat(path, {outer: {inner: np.column_stack([columns[key] for key in sorted(columns)])}, "spare": t[:9]})
    elif path.suffix == ".wav":
        loudest = np.column_stack([columns[key] / np.abs(columns[key]).max() for key in sorted(columns)])
        scipy.io.wavfile.write(path, int(rate), np.round(30_000 * loudest).astype(np.int16))
    else:
        _write_text(path, columns, shared)


def _signal(channel, entry, t, shared, seed):
    if channel == "time":
        return t / unit_named(entry.get("unit", "s")).factor
    random = np.random.default_rng([seed, len(channel)])
    if channel != "tachometer":
        return np.round(20 * np.sin(2 * np.pi * 147 * t) + random.standard_normal(t.size), 4)
    turns = t * parse_quantity(shared.get("spindle_speed", "3000 rpm"), "Hz") * entry.get("pulses_per_revolution", 1)
    return 5.0 * (turns % 1.0 < 0.1)


def _write_text(path, columns, shared):
    """A table with its names above it, numbered columns in their place, below as many lines of junk as are skipped."""
    delimiter = {"semicolon": ";", "tab": "\t"}.get(shared.get("delimiter"), ",")
    numbered = {key: values for key, values in columns.items() if isinstance(key, int)}
    named = [(key, values) for key, values in columns.items() if not isinstance(key, int)]
    laid = []
    while named or numbered:
        place = len(laid) + 1
        laid.append((f"column {place}", numbered.pop(place)) if place in numbered else
                    named.pop(0) if named else ("spare", next(iter(numbered.values()))))
    with path.open("w", newline="") as file:
        file.write("made by a recorder\n" * shared.get("skip_rows", 0))
        writer = csv.writer(file, delimiter=delimiter)
        writer.writerow([name for name, _ in laid])
        writer.writerows(zip(*(np.round(values, 7).tolist() for _, values in laid), strict=True))
