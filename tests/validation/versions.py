"""The lowest declared and the newest allowed versions of all dependencies, in environments of their own:  make versions

For every Python from 3.11 to 3.14 that pyenv has, or uv finds or can get. "Lowest" is the lowest version of each direct
dependency that is declared and has a wheel for that Python; packages are never built here. Tests: those of FILES, or all that
are not long where VERSIONS=all is set; on as many processes as there are cores, or PYTEST_XDIST_AUTO_NUM_WORKERS.
ENVIRONMENTS="3.12 lowest, 3.13 newest" runs those alone; the others keep their last result, of versions.json.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from datetime import date
from pathlib import Path
from typing import Any

from tests.validation.claims import Claim, Section

ROOT = Path(__file__).resolve().parents[2]
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
RESULTS = Path(__file__).with_suffix(".json")
RESOLUTIONS = {"lowest": "lowest-direct", "newest": "highest"}
EXTRAS = ("formats", "fast", "cluster", "bench", "dev")
# at least one that leans on each dependency: command line, files, HDF5, engines, readers of every format, Parquet, dask
FILES = ("cli/test_cli.py", "files/test_model_file.py", "scenario/test_scenario.py", "store/test_store.py",
         "store/test_verify.py", "engines/test_mujoco_engine.py", "analysis/test_stability.py",
         "readers/test_readers_binary.py", "export/test_export.py", "sweeps/test_sweep_cluster.py")
SHOWN = ("numpy", "scipy", "numba", "h5py", "matplotlib", "ruamel-yaml", "pydantic", "click", "rich", "plotly", "pyarrow",
         "distributed")  # fmt: skip


def _uv(*arguments: object) -> subprocess.CompletedProcess[str]:
    own = Path(sys.executable).with_name("uv")
    return subprocess.run([str(own if own.exists() else shutil.which("uv") or "uv"), *map(str, arguments)], cwd=ROOT,
                          capture_output=True, text=True)


def _interpreter(python: str) -> str:
    """Its path: one of pyenv's, whose names on the path answer for one version alone, or uv's; empty where there is none."""
    home = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    if kept := sorted(home.glob(f"versions/{python}.*/bin/python{python}")):
        return str(kept[-1])
    _uv("python", "install", "--quiet", python)
    found = _uv("python", "find", "--no-project", "--system", python)
    return found.stdout.strip() if found.returncode == 0 else ""


def _tried(interpreter: str, resolution: str, folder: Path) -> tuple[str, dict[str, str], bool]:
    """(what the tests said, versions installed, whether all passed)."""
    wanted, home = folder / "requirements.txt", folder / "venv"
    extras = [word for extra in EXTRAS for word in ("--extra", extra)]
    steps = (("venv", "--quiet", "--python", interpreter, home),
             ("pip", "compile", "--quiet", "--no-build", "--python", interpreter, "--resolution", resolution, *extras,
              "pyproject.toml", "-o", wanted),
             ("pip", "install", "--quiet", "--no-build", "--python", home, "-r", wanted),
             ("pip", "install", "--quiet", "--no-deps", "--python", home, "-e", "."))
    for step in steps:
        done = _uv(*step)
        if done.returncode:
            return f"{step[0]} {step[1]}: {' '.join(done.stderr.split())[:200]}", {}, False
    versions = dict(re.findall(r"^([\w.-]+)==(\S+)", wanted.read_text(), re.M))
    tests = [] if os.environ.get("VERSIONS") == "all" else [f"tests/{name}" for name in FILES]
    pytest = (home / "bin" / "python", "-m", "pytest", "-m", "not long", "-n", "auto", "--dist", "loadfile")
    done = subprocess.run([*pytest, *tests], cwd=ROOT, capture_output=True, text=True,
                          env={**os.environ, "TESTBED_CACHE": str(folder / "cache")})
    print(done.stdout[-20_000:], flush=True)
    lines = [line for line in done.stdout.splitlines() if re.search(r"\d (passed|failed|error)", line)]
    return (lines or ["no test ran"])[-1].strip("= "), versions, done.returncode == 0


def _run(python: str, name: str) -> None:
    """One environment, whose result is kept at once: a run of all that is stopped keeps what it found."""
    kept = _kept()
    if interpreter := _interpreter(python):
        with tempfile.TemporaryDirectory() as folder:
            said, versions, passed = _tried(interpreter, RESOLUTIONS[name], Path(folder))
        tests = "all that are not long" if os.environ.get("VERSIONS") == "all" else f"of {len(FILES)} files"
        kept[f"{python} {name}"] = {"said": re.sub(r" in [\d.]+s.*", "", said), "passed": passed, "tests": tests,
                                   "on": date.today().isoformat(), "versions": {one: versions.get(one, "-") for one in SHOWN}}
    else:
        kept[f"{python} {name}"] = {"said": "-", "passed": None}
    RESULTS.write_text(json.dumps(kept, indent=1) + "\n")
    print(python, name, kept[f"{python} {name}"], flush=True)


def _kept() -> dict[str, dict[str, Any]]:
    return json.loads(RESULTS.read_text()) if RESULTS.exists() else {}


def check() -> Section:
    """A line for each Python and each end of the declared versions."""
    wanted = [one.strip() for one in os.environ.get("ENVIRONMENTS", "").split(",") if one.strip()]
    every = [(python, name) for python in PYTHONS for name in RESOLUTIONS]
    for python, name in every:
        if not wanted or f"{python} {name}" in wanted:
            _run(python, name)
    claims, rows, kept = [], [], _kept()
    for python, name in every:
        what, one = f"Python {python}, {name} versions", kept.get(f"{python} {name}", {"said": "not run", "passed": None})
        note = f"tests {one['tests']}, {one['on']}" if one["passed"] is not None else ""
        note = "this Python could not be had where this was run" if one["said"] == "-" else note
        claims.append(Claim(what, "all tests pass", one["said"], one["passed"], note))
        if "versions" in one:
            rows.append((what, *one["versions"].values()))
    table = ("Versions", ("environment", *SHOWN), tuple(rows))
    return Section("Lowest and newest versions", tuple(claims), (table,), "The files of tests: " + ", ".join(FILES) + ".")
