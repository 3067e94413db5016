"""The analysis where MuJoCo is not installed: every module is imported, and a cut is identified in another process."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CODE = """
import importlib, pkgutil, sys
sys.modules["mujoco"] = None  # as where it is not installed: to import it is an ImportError
from testbed import analysis
for found in pkgutil.walk_packages(analysis.__path__, "testbed.analysis."):
    importlib.import_module(found.name)
from tests.analysis.test_identify import PAPER_START, records
print("DAMPING", analysis.multipliers.identify.identify(PAPER_START, records()).parameters["damping_ratio"].value)
"""


def test_every_module_of_the_analysis_is_imported_and_identifies_without_mujoco():
    path = os.pathsep.join((str(ROOT), str(ROOT / "tests")))
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, cwd=ROOT,
                          env={**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"})
    assert done.returncode == 0, done.stderr[-2000:]
    assert abs(float(done.stdout.split("DAMPING")[1]) / 0.0032 - 1.0) < 0.01
