"""A user's effect file that breaks the contract is refused in one line that says where, what and what to do."""

from __future__ import annotations

import math
import pickle
from pathlib import Path

import pytest

from testbed.catalogue import catalogue, read_effect
from testbed.effect import HOOKS
from testbed.problem import InputProblem
from testbed.trial import compilable

GOOD = '''"""An effect of one's own."""

import math

from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="One's own", law="F = -c v", source="none", validity="always", leaves="nothing much",
    parameters=(Parameter("coefficient", "c", "N s/m", "strength", neutral=0.0, bounds=(0.0, 10.0), example=1.0),),
)


def structure_force(velocity, coefficient):
    return -coefficient * velocity
'''
LAW = "    return -coefficient * velocity\n"
PARAMETER = '''Parameter("coefficient", "c", "N s/m", "strength", neutral=0.0, bounds=(0.0, 10.0), example=1.0)'''

FAULTS = {
    "no unit": ('"N s/m"', '""', "no unit"),
    "no neutral value": ("neutral=0.0, ", "", "neutral"),
    "slider without its state": ('source="none"', 'source="none", slider=("z", "coefficient")', "not its one state"),
    "slider that is more": (
        GOOD[GOOD.index('source="none"') :],
        GOOD[GOOD.index('source="none"') :].replace('"none"', '"none", states=("z",), slider=("z", "coefficient")')
        + "\n\ndef derivative_z(velocity):\n    return velocity\n"
        + "\n\ndef sensed_displacement(z, coefficient):\n    return coefficient * z\n",
        "structure_force and its state's derivative alone",
    ),
    "unit that is none": ('"N s/m"', '"furlongs^^2"', "no SI unit"),
    "unit that is not SI": ('"N s/m"', '"N s/mm"', "no SI unit"),
    "bounds the wrong way round": ("bounds=(0.0, 10.0)", "bounds=(10.0, 0.0)", "rising order"),
    "bounds not a number": ("bounds=(0.0, 10.0)", "bounds=(0.0, float('nan'))", "rising order"),
    "neutral value out of bounds": ("neutral=0.0", "neutral=-1.0", "neutral value lies outside"),
    "neutral value not a number": ("neutral=0.0", "neutral=float('nan')", "neutral value lies outside"),
    "example out of bounds": ("example=1.0", "example=11.0", "example lies outside"),
    "no law": ('law="F = -c v", ', "", "law"),
    "syntax": ("def structure_force(", "def structure_force((", "SyntaxError"),
    "missing module": ("import math", "import no_such_module_at_all", "no_such_module_at_all"),
    "fails on import": ("import math\n", "import math\n\n1 / 0\n", "ZeroDivisionError"),
    "no EFFECT": ("EFFECT = ", "effect = ", "no EFFECT"),
    "no hook": ("def structure_force", "def my_force", "my_force() is no hook"),
    "no function at all": (GOOD[GOOD.index("def structure_force") :], "", "no hook function"),
    "hook misspelt": (LAW, LAW + "\n\ndef strcture_force(velocity):\n    return velocity\n", "did you mean structure_force"),
    "derivative of no state": (LAW, LAW + "\n\ndef derivative_z(velocity):\n    return velocity\n", "belongs to no state"),
    "NaN at the neutral values": (LAW, "    return -velocity * coefficient / coefficient\n", "nan at the neutral values"),
    "not nothing at the neutral values": (LAW, "    return -velocity * (1.0 + coefficient)\n", "at the neutral values"),
    "requires what is not there": ('source="none"', 'source="none", requires=("no_such",)', "unknown effect 'no_such'"),
    "unknown argument": ("(velocity, coefficient)", "(velocity, coeficient)", "'coeficient'"),
    "argument of another hook": ("(velocity, coefficient)", "(chip, coefficient)", "'chip'"),
    "nothing switches it off": ("example=1.0)", "example=1.0, vanishes=False)", "switches the effect off"),
    "two parameters of one name": (PARAMETER + ",", PARAMETER + ", " + PARAMETER + ",", "two parameters"),
    "state without derivative": ('title="One\'s own",', 'title="One\'s own", states=("memory",),', "derivative_memory"),
    "not compilable": (LAW, "    return {}.setdefault(velocity, open('a'))\n", "does not compile"),
    "a dictionary": (LAW, "    force = 1.0\n    return {}.get(velocity)\n", "no number comes of"),
    "a module that does not compile": (LAW, "    import os\n    return os.getpid()\n", "does not compile"),
    "unknown name": (LAW, "    return -coefficient * velocty\n", "velocty"),
    "numpy array": (LAW, "    return (coefficient, velocity)\n", "not a number"),
    "leaves the program": ("import math\n", "import math\nimport sys\n\nsys.exit(3)\n", "SystemExit: 3"),
    "prints": (LAW, "    print(velocity)\n" + LAW, "calls print()"),
    "prints when it is read": ("import math\n", "import math\n\nprint(math.pi)\n", "calls print()"),
    "random numbers": (
        LAW,
        "    import random\n\n    return -coefficient * random.random()\n",
        "structure_force() draws random numbers (random.random)",
    ),
    "random numbers of numpy": (
        LAW,
        "    import numpy as np\n\n    return -coefficient * np.random.normal()\n",
        "structure_force() draws random numbers (numpy.random.normal)",
    ),
    "something else every time": (
        LAW,
        LAW + "_DRAWN = iter(range(99))\n\n\ndef measure(signal):\n    return signal + next(_DRAWN)\n",
        "measure() gives something else at the same arguments",
    ),
    "a title that is no text": ('title="One\'s own"', "title=5", "title is no text"),
    "a law that is no text": ('law="F = -c v"', 'law=("F", "-c v")', "law is no text"),
    "a confusion that is no pair": ('"nothing much"', '"", confused_with=("helix", "a cut")', "no tuple of pairs"),
    "parameters without a comma": ("(" + PARAMETER + ",),", PARAMETER + ",", "parameters is no tuple"),
    "a meaning that is no text": ('"strength"', "5", "parameter coefficient: its meaning is no text"),
    "no return": (LAW, "    coefficient * velocity\n", "not a number"),
}


def one_line(problem: InputProblem, path: Path) -> str:
    text = str(problem)
    assert "\n" not in text and "Traceback" not in text and len(text) < 600
    assert text.startswith(str(path)) and problem.what and problem.do
    assert str(pickle.loads(pickle.dumps(problem))) == text
    return text


def test_the_good_file_is_taken_and_acts(tmp_path):
    (tmp_path / "my_drag.py").write_text(GOOD)
    effects = catalogue(tmp_path)
    assert effects["my_drag"].hooks["structure_force"](2.0, 3.0) == -6.0
    assert set(catalogue()) < set(effects) and "my_drag" not in catalogue()


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_file_is_refused_in_one_line(fault, tmp_path):
    old, new, says = FAULTS[fault]
    assert old in GOOD
    path = tmp_path / "my_drag.py"
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(InputProblem) as caught:
        catalogue(tmp_path)
    assert says in one_line(caught.value, path)


@pytest.mark.parametrize("fault", FAULTS)
def test_the_line_of_the_fault_is_named_where_there_is_one(fault, tmp_path):
    """The line lies in the file, and within the part that the fault was put into."""
    old, new, _ = FAULTS[fault]
    path = tmp_path / "my_drag.py"
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(InputProblem) as caught:
        catalogue(tmp_path)
    card, law = GOOD[: GOOD.index("EFFECT")].count("\n") + 1, GOOD[: GOOD.index("def structure")].count("\n") + 1
    line = caught.value.line
    if fault in ("no EFFECT", "requires what is not there"):
        assert line is None  # nothing in the file stands for what is not there
    elif GOOD.index(old) < GOOD.index("EFFECT"):
        assert line < card
    elif GOOD.index(old) < GOOD.index("def") or fault == "no function at all":
        assert card <= line <= card + 4
    else:
        assert law <= line <= law + 6


def test_what_a_file_does_when_it_is_run_by_itself_is_its_own_business(tmp_path):
    (tmp_path / "my_drag.py").write_text(
        GOOD + '\n\nif __name__ == "__main__":\n    print(structure_force(1.0, 1.0))\n')
    assert "my_drag" in catalogue(tmp_path)


def test_a_table_drawn_once_from_a_seed_is_no_chance(tmp_path):
    table = "import random\n\n_ROUGH = random.Random(3).random()\n"
    (tmp_path / "my_drag.py").write_text(GOOD.replace("import math\n", table).replace("* velocity", "* velocity * _ROUGH"))
    assert "my_drag" in catalogue(tmp_path)


def test_a_folder_that_cannot_be_read_is_not_taken_for_an_empty_one(tmp_path, monkeypatch):
    import os

    listed = os.listdir

    def refused(folder):
        if Path(folder) == tmp_path:
            raise PermissionError(13, "Permission denied", str(folder))
        return listed(folder)

    monkeypatch.setattr(os, "listdir", refused)
    with pytest.raises(InputProblem) as caught:
        catalogue(tmp_path)
    assert "cannot be read (Permission denied)" in one_line(caught.value, tmp_path)


def test_the_line_of_the_fault_is_named(tmp_path):
    path = tmp_path / "my_drag.py"
    path.write_text(GOOD.replace("(velocity, coefficient)", "(velocity, mistake)"))
    with pytest.raises(InputProblem) as caught:
        read_effect(path)
    assert str(caught.value).startswith(f"{path}:{1 + GOOD[:GOOD.index('def structure')].count(chr(10))}: ")


def test_the_line_is_named_in_a_folder_given_as_a_relative_path_too(tmp_path, monkeypatch, recwarn):
    monkeypatch.chdir(tmp_path)
    for fault in ("no unit", "missing module", "syntax", "bounds the wrong way round", "a dictionary"):
        old, new, says = FAULTS[fault]
        Path("my_drag.py").write_text(GOOD.replace(old, new, 1))
        with pytest.raises(InputProblem, match=says) as caught:
            read_effect(Path("my_drag.py")) if fault != "a dictionary" else catalogue(".")
        assert caught.value.line is not None, fault
    assert "Numba" not in "".join(str(one.category) for one in recwarn)


@pytest.mark.parametrize("cookie", ["", "# -*- coding: latin-1 -*-\n"])
def test_a_file_that_is_not_utf_8_is_refused_with_its_line(cookie, tmp_path):
    path = tmp_path / "my_drag.py"
    path.write_bytes((cookie + GOOD.replace(LAW, "    # Dämpfung\n" + LAW)).encode("latin-1"))
    with pytest.raises(InputProblem) as caught:
        catalogue(tmp_path)
    assert "is not UTF-8 text" in one_line(caught.value, path)
    assert path.read_bytes().splitlines()[caught.value.line - 1] == b"    # D\xe4mpfung"


@pytest.mark.parametrize("name", ["my drag", "2nd", "my-drag", "my.drag"])
def test_a_file_whose_name_no_model_file_could_bear_is_refused(name, tmp_path):
    path = tmp_path / f"{name}.py"
    path.write_text(GOOD)
    with pytest.raises(InputProblem) as caught:
        catalogue(tmp_path)
    assert f"'{name}' is no name for an effect" in one_line(caught.value, path)


def test_a_name_of_the_catalogue_is_not_taken_again(tmp_path):
    path = tmp_path / "contact_loss.py"
    path.write_text(GOOD)
    with pytest.raises(InputProblem) as caught:
        catalogue(tmp_path)
    assert "exists already" in one_line(caught.value, path)


def test_a_file_moved_to_another_folder_keeps_its_name_in_the_cache_of_compiled_kernels(tmp_path):
    """Compiled code refers to the effect's module by name, and the cache is found by the file's content."""
    modules = []
    other = GOOD.replace("-coefficient", "-2.0 * coefficient")
    for folder, text in (("first", GOOD), ("second", GOOD), ("third", other)):
        (tmp_path / folder).mkdir()
        path = tmp_path / folder / "my_drag.py"
        path.write_text(text)
        modules.append(read_effect(path).hooks["structure_force"].__module__)
    assert modules[0] == modules[1] != modules[2]


def test_a_missing_folder_is_said(tmp_path):
    with pytest.raises(InputProblem) as caught:
        catalogue(tmp_path / "nowhere")
    assert "is not a folder" in one_line(caught.value, tmp_path / "nowhere")


def test_a_model_with_an_unknown_effect_or_without_a_parameter_is_refused():
    from testbed.cut import Cut, Sampling
    from testbed.engines import fast
    from testbed.machine import Cutter, Cutting, Model, Structure

    model = Model(Structure(2.573, 146.4, 0.0032), Cutter(), Cutting())
    course, sampling = Cut(3810 * 2 * math.pi / 60, 1e-3, passes=2), Sampling(1000.0, 10)
    with pytest.raises(KeyError, match="proces_damping"):
        fast.simulate(model.with_effect("proces_damping", coefficient=1.0), course, sampling)
    with pytest.raises(KeyError, match="angle"):
        fast.simulate(model.with_effect("runout", offset=1e-5), course, sampling)


def test_two_effects_that_both_replace_the_chip_are_refused_in_one_line(tmp_path):
    """The only way in which effects cannot be together: all others add up or multiply."""
    from testbed.engines.model_arrays import active_effects
    from testbed.machine import Model, Structure

    assert [name for name, hook in HOOKS.items() if hook.joins == "replace"] == ["chip"]
    assert [name for name, effect in catalogue().items() if "chip" in effect.hooks] == ["contact_loss"]
    law = GOOD.replace("def structure_force(velocity, coefficient):\n" + LAW,
                       "def chip(penetration, coefficient):\n    return penetration + coefficient\n")
    assert law != GOOD
    (tmp_path / "my_chip.py").write_text(law)
    effects = catalogue(tmp_path)
    model = Model(Structure(2.573, 146.4, 0.0032)).with_effect("contact_loss").with_effect("my_chip", coefficient=1.0)
    with pytest.raises(InputProblem, match="contact_loss and my_chip both replace the chip"):
        active_effects(model, effects)
    assert set(active_effects(model.with_effect("my_chip", coefficient=0.0), effects)) == {"contact_loss"}


def test_a_relative_folder_is_another_place_in_another_working_folder(tmp_path, monkeypatch):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        (tmp_path / name / f"{name}_drag.py").write_text(GOOD)
        monkeypatch.chdir(tmp_path / name)
        assert f"{name}_drag" in catalogue(".")


def test_every_quantity_that_a_hook_may_ask_for_has_a_value_to_be_tried():
    known = {*compilable._PLAUSIBLE, *compilable._SIGNED, *compilable._SAMPLED}
    assert {name for hook in HOOKS.values() for name in hook.offers} == known
