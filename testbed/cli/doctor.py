"""`testbed doctor`: whether this installation works, and what of it is missing."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from testbed.cli._answer import Answer

EXTRAS = {"nptdms": "TDMS files (extra formats)", "pyuff": "UFF files (extra formats)",
          "soundfile": "WAV files (extra formats)", "pyarrow": "Parquet files (extra formats)",
          "hdf5plugin": "zstd in HDF5 files (extra fast)", "sdypy": "hammer taps (extra tap)"}


@click.command(short_help="Check this installation.", epilog="Example: testbed doctor --json -")
@click.option("--json", "json_file", metavar="FILE", help="Write the findings as JSON; - for standard output.")
@click.option("--quiet", is_flag=True, help="Print nothing but errors.")
def command(json_file: str | None, quiet: bool) -> None:
    """Check Python, the packages, both engines and the drawing; say what does not work and what to do.

    Exits with 0 if everything needed works, with 1 if not.
    """
    answer = Answer(json_file, quiet)
    if sys.platform == "linux":
        os.environ.setdefault("MUJOCO_GL", "egl")  # read once, when mujoco is first imported: before the engines' check
    findings = [_python(), _shadowed(), *_checked(), _kept(), *_extras()]
    for finding in findings:
        answer.say(f"{finding['state']:8} {finding['what']}")
    answer.finish({"ok": all(finding["state"] != "broken" for finding in findings), "findings": findings})
    if any(finding["state"] == "broken" for finding in findings):
        raise SystemExit(1)


def _finding(state: str, what: str) -> dict[str, str]:
    return {"state": state, "what": what}


def _python() -> dict[str, str]:
    version = ".".join(map(str, sys.version_info[:3]))
    good = (3, 11) <= sys.version_info[:2] < (3, 15)
    return _finding("ok" if good else "broken", f"Python {version}" + ("" if good else ": install 3.11 to 3.14"))


def _shadowed() -> dict[str, str]:
    """Whether a folder of the user's own, named as our package is, takes its place under `python -m`."""
    own = Path.cwd() / "testbed"
    if own.is_dir() and own.resolve() != Path(__file__).resolve().parents[1]:
        return _finding("note", f"the folder {own} bears the name of our package: `python -m testbed` takes it, so rename it")
    return _finding("ok", "package testbed")


def _checked() -> list[dict[str, str]]:
    """The checks that compute something."""
    return [_check("fast engine", lambda: _moves("fast")), _check("MuJoCo engine", lambda: _moves("mujoco")),
            _check("catalogue of effects", _effects), _check("HDF5 files", _hdf5),
            _check("pictures of charts", _figure), _check("pictures of machines", _rig, needed=False)]


def _check(name: str, act: Callable[[], str], needed: bool = True) -> dict[str, str]:
    try:
        return _finding("ok", f"{name}: {act()}")
    except Exception as problem:  # whatever goes wrong here is what the user came to learn
        said = " ".join(str(problem).split())
        return _finding("broken" if needed else "missing", f"{name}: {type(problem).__name__}: {said}")


def _moves(engine: str) -> str:
    import numpy as np

    from testbed.api.sweep import engine_named
    from testbed.cut import Cut, whole_cut_sampling
    from testbed.machine import Cutter, Cutting, Model, Structure

    model = Model(Structure(2.573, 146.6, 0.0032), Cutter(), Cutting())
    cut = Cut(spindle_speed=399.0, axial_depth_of_cut=2.9e-3, passes=5)
    recording: Any = engine_named(engine)(model, cut, whole_cut_sampling(cut, 1, 12_800.0))
    peak = float(np.max(np.abs(recording.channels["displacement"])))
    if not 1e-6 < peak < 1e-3:
        raise ArithmeticError(f"a test cut moves by {peak:g} m")
    return f"a test cut moves by {peak * 1e6:.1f} um"


def _kept() -> dict[str, str]:
    """Where compiled functions are kept: what lies there runs as the user's own code."""
    from testbed.system.kernel_cache import cache_folder, kept_bytes

    folder = cache_folder()
    if folder is None:
        return _finding("missing", "a folder of your own for compiled functions: every start compiles anew; name one with "
                                   "TESTBED_CACHE")
    return _finding("ok", f"compiled functions: {kept_bytes(folder) / 1e6:.1f} MB in {folder}, yours alone; it may be removed")


def _effects() -> str:
    from testbed.catalogue import catalogue

    return f"{len(catalogue())} effects"


def _hdf5() -> str:
    import h5py

    return f"h5py {h5py.__version__}, HDF5 {h5py.version.hdf5_version}"


def _figure() -> str:
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # noqa: F401 - that it imports is the finding

    return f"matplotlib {matplotlib.__version__}"


def _rig() -> str:
    import tempfile

    from testbed.view import render_rig

    with tempfile.TemporaryDirectory() as folder:
        render_rig(Path(folder) / "rig.png", width=64, height=48)
    return "rendered without a screen"


def _extras() -> list[dict[str, str]]:
    from importlib.util import find_spec

    return [_finding("ok" if find_spec(name) else "missing", f"optional: {what}") for name, what in EXTRAS.items()]
