"""The wheel in a fresh environment, among a user's own `analysis`, `models` and scripts; and what a type checker sees of it."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OWN = {
    "analysis/__init__.py": "WHOSE = 'mine'\n", "models/__init__.py": "WHOSE = 'mine'\n", "scenarios.py": "WHOSE = 'mine'\n",
    "statistics_of_mine.py": "import numpy\nimport analysis, models, scenarios\nfrom testbed import multipliers\n"
                             "assert {analysis.WHOSE, models.WHOSE, scenarios.WHOSE} == {'mine'}\n"
                             "print(numpy.round(abs(multipliers('model.yaml', '3810 rpm', '2.9 mm').multipliers[0]), 4))\n"
}
API = """
import os, testbed, testbed.analysis, testbed.models
assert 'site-packages' in testbed.__file__ and testbed.__version__ == '0.1.0'
made = testbed.sweep('scenario.yaml', 'cuts.h5', progress=False)
found = testbed.identify(made.data, testbed.load('model.yaml'))
found.save_model('found.yaml')
chart = testbed.chart('found.yaml', '3000 rpm:4500 rpm:5', '0.5 mm:4 mm:4')
chart.plot().savefig('chart.png')
print(made, found, chart, sep='\\n')
"""
STRICT = """
import numpy as np

import testbed


def limits(path: str) -> list[float]:
    model = testbed.load(path, testbed.Model)
    changed = model.with_values({"damping_ratio": 0.01})
    chart = testbed.chart(changed, "2500 rpm:4500 rpm:11", np.linspace(1e-4, 4e-3, 11), risk="5%", progress=False)
    found: testbed.Multipliers = testbed.multipliers(model, 400.0, "2.9 mm")
    text: str = found.stability + found.json
    assert text
    return [float(one) for one in chart.stability_limit]


def loop(campaign_file: str, model_file: str) -> float:
    campaign, model = testbed.load(campaign_file), testbed.load(model_file)
    seen = testbed.inspect(campaign)
    print([one.name for one in seen.records], seen.notes)
    compared = testbed.compare(campaign, model, progress=lambda title, done, total: print(title, done, total))
    if compared.adequate:
        return compared.error
    try:
        diagnosis = testbed.diagnose(campaign, compared.model)
        added: testbed.Addition = testbed.add(diagnosis.effects, campaign, model)
    except testbed.InputProblem as problem:
        print(problem.place, problem.what, problem.do)
        raise
    low: float = added.parameters["natural_frequency"].low
    added.plot().savefig("added.png")
    print(added.report("pages").name, added.save_model("new.yaml"), compared.to_dict()["error"])
    made: testbed.Recording = testbed.simulate(added.model, "3810 rpm", 2.9e-3, noise={"displacement": "1 um"})
    swept = testbed.sweep("scenario.yaml", "cuts.h5", workers=testbed.Workers(2, processes=True))
    for recording in swept.data:
        print(recording.channels["displacement"].max(), made.sampling_rate)
    scores = testbed.score(swept.data, noise=("0.5 um", 1e-6), method="waveform", tests=[3])
    print([one.rms for one in scores.scores], scores.save("scores")[0].name, scores.cost[0].median)
    if testbed.verify("cuts.h5").intact:
        training: testbed.TrainingSet = testbed.export(swept.data, "set", window=1024, split_by="machine")
        print(training.folder.name, training.content["runs"])
    print([one.title for one in testbed.list_effects().values()], testbed.effect_card("runout")["law"])
    return low
"""


def run(*command: object, folder: Path, fails: bool = False) -> str:
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run([str(one) for one in command], cwd=folder, capture_output=True, text=True, env=environment)
    assert (done.returncode != 0) == fails, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    run(sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps", "--no-build-isolation",
        "-w", folder, ROOT, folder=folder)
    return next(folder.glob("*.whl"))


@pytest.fixture(scope="module")
def python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of a fresh environment that holds the wheel; its dependencies are those of this one."""
    folder = tmp_path_factory.mktemp("fresh")
    run(sys.executable, "-m", "venv", "--without-pip", folder / "venv", folder=folder)
    packages = next((folder / "venv").glob("lib/python*/site-packages"))
    import numpy

    lent = [str(Path(numpy.__file__).parents[1]), *(place for place in sys.path if "site-packages" not in place and
            (Path(place) / "threadpoolctl.py").is_file())]
    (packages / "lent.pth").write_text("\n".join(dict.fromkeys(lent)) + "\n")
    run(sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps", "--target", packages,
        wheel, folder=folder)
    return folder / "venv" / "bin" / "python"


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    for name, text in OWN.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


@pytest.mark.long
def test_a_wheel_holds_one_import_name(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {name.split("/")[0] for name in names if ".dist-info" not in name} == {"testbed"}
    assert {"testbed/py.typed", "testbed/analysis/estimate.py", "testbed/models/flexure/flexure.xml", "testbed/api/chart.py",
            "testbed/scenarios/published_tests.yaml"} <= set(names)


@pytest.mark.long
def test_it_works_among_a_user_s_own_names(python: Path, mine: Path) -> None:
    testbed = python.with_name("testbed")
    if not testbed.exists():  # pip's --target puts scripts elsewhere
        testbed.write_text(f"#!{python}\nfrom testbed.__main__ import main\nmain()\n")
        testbed.chmod(0o755)
    assert "A virtual machining testbed" in run(testbed, "--help", folder=mine)
    run(testbed, "init", folder=mine)
    (mine / "scenario.yaml").write_text((mine / "scenario.yaml").read_text().replace("60 rev", "40 rev"))
    assert "cells" in run(testbed, "chart", "model.yaml", "--speed", "3000:4500:7", "--depth", "0.5:4:5", folder=mine)
    assert run(python, "statistics_of_mine.py", folder=mine) == "0.7995\n"
    assert "<Chart: 5 speeds x 4 depths" in run(python, "-c", API, folder=mine) and (mine / "chart.png").stat().st_size > 5000
    assert "error: nix.yaml" in run(testbed, "multipliers", "nix.yaml", "--speed", "1", "--depth", "1", folder=mine, fails=True)


@pytest.mark.long
def test_strict_type_checking_of_the_public_api(python: Path, tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    (tmp_path / "script.py").write_text(STRICT)
    told = run(sys.executable, "-m", "mypy", "--strict", "--python-executable", python, "--cache-dir", tmp_path / "cache",
               "script.py", folder=tmp_path)
    assert "Success: no issues found" in told
    wrong = STRICT.replace("-> list[float]", "-> list[str]").replace("compared.error", "compared.eror")
    (tmp_path / "script.py").write_text(wrong)
    told = run(sys.executable, "-m", "mypy", "--strict", "--python-executable", python, "--cache-dir", tmp_path / "cache",
               "script.py", folder=tmp_path, fails=True)
    assert 'script.py:14: error' in told and '"eror"' in told  # so that it saw the types, and not Any
