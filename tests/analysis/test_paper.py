"""`testbed paper`: the parts that are quick say what they found; the page, resuming, bad input."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from testbed.analysis.paper import LONGEST_FIRST, PARTS
from testbed.analysis.paper.bench import IDENTIFIED, Bench
from testbed.analysis.paper.fig6 import area_between, boundary
from testbed.analysis.paper.immersion import outcomes_right
from testbed.analysis.paper.page import count, write_page
from testbed.analysis.paper.part import Part, Statement, as_dict, from_dict
from testbed.analysis.paper.table1 import plain_multipliers
from testbed.analysis.paper.table2 import machine, search
from testbed.cli import main
from testbed.cli._paper import Work, fingerprint
from testbed.engines import fast


def run(*arguments: str) -> int:
    """The exit code of a command line."""
    with pytest.raises(SystemExit) as stop:
        main(["paper", *arguments])
    return int(stop.value.code or 0)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """(folder, its JSON) of a quick run of two parts."""
    folder = tmp_path_factory.mktemp("paper")
    only = [word for name in ("fig1", "fig6") for word in ("--only", name)]
    assert run("-o", str(folder / "out"), "--quick", "--workers", "1", *only, "--json", str(folder / "paper.json")) == 0
    return folder / "out", json.loads((folder / "paper.json").read_text())


def test_the_targets_of_figures_1_and_6_hold(made):
    _, found = made
    parts = {part["name"]: part for part in found["parts"]}
    errors = parts["fig1"]["numbers"]["median_error"]
    assert 0 < errors["4"] <= 1e-3 and 0 < errors["8"] <= 1e-6
    assert 0 < parts["fig6"]["numbers"]["area_between"] < 0.01
    assert parts["fig6"]["numbers"]["published_right"]["identified"] == 5
    assert found["differ"] == 0 and found["agree"] >= 5


def test_the_page_shows_every_statement_and_picture(made):
    folder, found = made
    page = (folder / "paper.html").read_text()
    for part in found["parts"]:
        for one in part["statements"]:
            assert one["claim"].split("<")[0][:40] in page
    sources = re.findall(r'src="([^"]+)"', page)
    assert sources == ["fig1.svg", "fig6.svg"]
    for name in (*sources, *(source.replace(".svg", ".png") for source in sources)):
        assert (folder / name).stat().st_size > 5000
    assert "width=device-width" in page and "A quick look" in page and "inferred" in page


def test_finished_parts_are_kept_and_others_are_not(made, capsys):
    folder, _ = made
    before = (folder / "parts" / "fig6.json").stat().st_mtime_ns
    assert run("-o", str(folder), "--quick", "--workers", "1", "--only", "fig6", "--resume") == 0
    assert "(kept)" in capsys.readouterr().out
    assert (folder / "parts" / "fig6.json").stat().st_mtime_ns == before
    assert fingerprint(Work(str(folder), 1, True)) != fingerprint(Work(str(folder), 2, True))


def test_an_unknown_part_is_answered(tmp_path, capsys):
    assert run("-o", str(tmp_path / "out"), "--only", "fig9") == 2
    said = capsys.readouterr().err
    assert said.startswith("error: --only: there is no part 'fig9': known: fig1") and not (tmp_path / "out").exists()


def test_every_part_is_in_both_orders():
    assert sorted(PARTS) == sorted(LONGEST_FIRST)


def test_the_published_outcomes_need_the_inferred_immersion():
    assert outcomes_right(0.162) == 5 and outcomes_right(0.12) < 5


def test_a_machine_of_another_frequency_has_another_boundary():
    first = boundary(IDENTIFIED, (81, 40))
    other = boundary(replace(IDENTIFIED, structure=replace(IDENTIFIED.structure, natural_frequency=150.0)), (81, 40))
    assert area_between(first, first) == 0.0 and area_between(first, other) > 0.02


def test_the_plain_estimate_is_exact_without_noise():
    mu = np.array([0.7, -0.5])
    states = (mu[None, :] ** np.arange(60)[:, None]) @ np.array([[1.0, 0.3], [0.2, -0.8]])
    found = plain_multipliers(states + 5.0, 2, True)
    assert np.abs(np.sort(found.real) - np.sort(mu)).max() < 1e-6


def test_a_plain_search_from_the_ring_down_arrives():
    from testbed.analysis.linear.delay_equation import milling_equation
    from testbed.analysis.linear.temporal_elements import characteristic_multipliers
    from testbed.analysis.paper.bench import cut_at
    from testbed.analysis.paper.table2 import ELEMENTS, TESTS

    cuts = [cut_at(*test) for test in TESTS]
    exact = np.array([characteristic_multipliers(milling_equation(IDENTIFIED, cut), ELEMENTS)[0] for cut in cuts])
    targets = exact.real + 1j * np.abs(exact.imag)
    found = search(cuts, targets, (920.0, 0.0032, 5e8), False)
    assert found.reached(IDENTIFIED) and not found.reached(machine(930.0, 0.0032, 2.16e8))
    assert found.misfits[0] > 0.1 and found.misfits[-1] < 1e-6


def test_a_part_survives_its_file():
    part = Part("fig1", "One", ("said",), (), (), (Statement("fig. 1", "a", "b", "c", None),
                                                           Statement("x", "a", "b", "c", False)))
    again = from_dict(json.loads(json.dumps(as_dict(part))))
    assert again == part and count([again]) == (0, 1, 1)


def test_text_from_outside_cannot_become_markup(tmp_path):
    part = Part("fig1", "<b>", ("<script>",), (), (), (Statement("x", "<i>", "a", "b", True),))
    page = write_page([part], tmp_path, False, 1).read_text()
    assert "<script>" not in page and "&lt;i&gt;" in page and "A quick look" not in page


def test_randomness_depends_on_seed_and_key_alone(tmp_path):
    first, second = (Bench(fast.simulate, fast.simulate, tmp_path, seed).random("a", 1).random() for seed in (1, 1))
    other = Bench(fast.simulate, fast.simulate, tmp_path, 2).random("a", 1).random()
    assert first == second != other
