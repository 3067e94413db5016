"""Sound measured files of every format where memory is scarce: read, or refused in one line; never a crash or a hang."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from tests.validation.adversities.files import answered, prepared
from tests.validation.adversities.probe import CAMPAIGN, Probe
from tests.validation.adversities.runner import EITHER, REFUSED, Result, forked

SAMPLES, RATE = 500_000, 12_800  # 40 s
ROOMS = (0, 20, 60, 140, 200, 300, 600)  # MB that the command may take beyond what the interpreter and its modules have
FORMATS = ("csv", "h5", "wav", "mat", "parquet")
COMMANDS = {"inspect": (), "compare": ("-m", "model.yaml"), "diagnose": ("-m", "model.yaml")}


def _written(folder: Path, kind: str) -> None:
    """A free vibration and noise, in a file of a kind."""
    time, file = np.arange(SAMPLES) / RATE, folder / f"cut.{kind}"
    values = 20 * np.sin(900 * time) + np.random.default_rng(1).normal(0, 0.1, SAMPLES)
    if kind == "csv":
        file.write_text("disp\n" + "\n".join(f"{value:.4f}" for value in values) + "\n")
    elif kind == "h5":
        with h5py.File(file, "w") as data:
            data["disp"] = values
    elif kind == "wav":
        import scipy.io.wavfile

        scipy.io.wavfile.write(file, RATE, np.rint(values * 1000).astype(np.int16))
    elif kind == "mat":
        import scipy.io

        scipy.io.savemat(file, {"disp": values})
    else:
        import pyarrow as arrow
        import pyarrow.parquet as parquet

        parquet.write_table(arrow.table({"disp": values}), file)
    text = CAMPAIGN.replace("FILE", file.name)
    (folder / "campaign.yaml").write_text(text.replace("disp,", "1,") if kind == "wav" else text)


def run() -> Iterator[Result]:
    """Each format and room by `inspect`, and one format by the commands that fit."""
    with tempfile.TemporaryDirectory() as name:
        sound = Path(name)
        prepared(sound)
        asked = [("inspect", kind, room) for kind in FORMATS for room in ROOMS]
        for command, kind, room in [*asked, *((one, "h5", room) for one in ("compare", "diagnose") for room in ROOMS[::2])]:

            def make(folder: Path, command: str = command, kind: str = kind) -> tuple[str, ...]:
                _written(folder, kind)
                return (command, "campaign.yaml", *COMMANDS[command])

            with tempfile.TemporaryDirectory() as own:
                probe = Probe("scarce memory", f"{command} of {kind}, {room} MB", make, REFUSED if room < 10 else EITHER)
                yield answered(probe, sound, Path(own), partial(forked, room=room * 1_000_000))
