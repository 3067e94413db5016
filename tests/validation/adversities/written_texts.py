"""Texts that people write, models, campaigns and scenarios, with values that nobody means and structures without end."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from tests.validation.adversities.probe import CAMPAIGN, DEEP, MODEL, SCENARIO, TABLE, Make
from tests.validation.adversities.runner import EITHER, REFUSED

RECORD = "  - {file: cut.csv, kind: cut, spindle_speed: 3810 rpm, depth_of_cut: 2 mm, feed: 0.1 mm/tooth}"


def _changed(old: str, new: str, text: str = CAMPAIGN, command: str = "inspect") -> Make:
    def make(folder: Path) -> Sequence[object]:
        (folder / "cut.csv").write_text(TABLE)
        if text is MODEL:
            (folder / "model.yaml").write_text(MODEL.replace(old, new))
            return "multipliers", "model.yaml", "--speed", "3810", "--depth", "2"
        if text is SCENARIO:
            (folder / "scenario.yaml").write_text(SCENARIO.replace(old, new))
            return "run", "scenario.yaml", "-o", "new.h5"
        (folder / "campaign.yaml").write_text(CAMPAIGN.replace("FILE", "cut.csv").replace(old, new))
        return (command, "campaign.yaml") if command == "inspect" else (command, "campaign.yaml", "-m", "model.yaml")

    return make


BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{'bcdefghij'[k]}: &{'bcdefghij'[k]} [{','.join(['*' + 'abcdefghij'[k]] * 9)}]\n" for k in range(8)
)
WRITTEN: dict[str, tuple[Make, Sequence[int]]] = {
    **{
        f"model: mass {value}": (_changed("2.573 kg", value, MODEL), REFUSED)
        for value in ("0 kg", "-1 kg", ".nan", ".inf", "1e400 kg", "nan kg", "inf kg", "[1]", "{a: 1}", "1" * DEEP, "x" * DEEP)
    },
    "model: frequency 1e300 Hz": (_changed("147.5 Hz", "1e300 Hz", MODEL), EITHER),
    "model: frequency 1e-300 Hz": (_changed("147.5 Hz", "1e-300 Hz", MODEL), EITHER),
    "model: damping 1": (_changed("0.005", "1", MODEL), REFUSED),
    "model: coefficient 1e300": (_changed("600 N/mm^2", "1e300 N/mm^2", MODEL), REFUSED),
    "model: flutes 1e9": (_changed("flutes: 1", "flutes: 1000000000", MODEL), REFUSED),
    "model: a diameter of 1e-300 mm": (_changed("19.05 mm", "1e-300 mm", MODEL), EITHER),
    "model: effects of 5000 names": (
        _changed("cutter:", "effects: {" + ", ".join(f"e{k}: {{}}" for k in range(DEEP)) + "}\ncutter:", MODEL),
        REFUSED,
    ),
    "model: 5000 nested lists": (_changed("2.573 kg", "[" * DEEP + "]" * DEEP, MODEL), REFUSED),
    "model: 5000 nested mappings": (_changed("2.573 kg", "{a: " * DEEP + "1" + "}" * DEEP, MODEL), REFUSED),
    "model: aliases without end": (_changed("structure:", BOMB + "structure:", MODEL), REFUSED),
    "model: an alias of itself": (_changed("2.573 kg", "&a [*a]", MODEL), REFUSED),
    "model: a merge of itself": (_changed("structure:", "x: &a {<<: *a}\nstructure:", MODEL), REFUSED),
    "model: a tag of Python's": (_changed("2.573 kg", "!!python/object/apply:os.system [true]", MODEL), REFUSED),
    "model: a binary tag": (_changed("2.573 kg", "!!binary x", MODEL), REFUSED),
    "model: a date": (_changed("2.573 kg", "2026-01-01", MODEL), REFUSED),
    "model: a date out of range": (_changed("2.573 kg", "2026-99-99", MODEL), REFUSED),
    "model: a set": (_changed("2.573 kg", "!!set {a, b}", MODEL), REFUSED),
    "model: a key that is a list": (_changed("mass:", "? [a, b]\n:", MODEL), REFUSED),
    "model: a comment of 1.5 MB": (_changed("structure:", "# " + "a b " * 375_000 + "\nstructure:", MODEL), EITHER),
    "model: a line of 1.5 MB": (_changed("2.573 kg", "a" * 1_500_000, MODEL), REFUSED),
    "model: 1.5 MB of quotes": (_changed("2.573 kg", "'" * 1_500_001, MODEL), REFUSED),
    "model: 100,000 lines of comment": (_changed("structure:", "# a\n" * 100_000 + "structure:", MODEL), EITHER),
    "model: 1.5 MB of blanks": (_changed("structure:", " " * 1_500_000 + "\nstructure:", MODEL), EITHER),
    "model: 300,000 keys": (
        _changed("structure:", "".join(f"k{k}: 1\n" for k in range(300_000)) + "structure:", MODEL),
        REFUSED,
    ),
    "model: two documents": (_changed("structure:", "a: 1\n---\nstructure:", MODEL), REFUSED),
    "model: a NUL": (_changed("2.573", "2.5\0", MODEL), REFUSED),
    "model: an emoji for a unit": (_changed("2.573 kg", "2.573 \U0001f600", MODEL), REFUSED),
    "model: lone surrogates": (_changed("2.573 kg", '"\\ud800"', MODEL), REFUSED),
    "model: a number of Arabic digits": (_changed("2.573 kg", "\u0662 kg", MODEL), EITHER),
    "campaign: no records": (
        _changed(CAMPAIGN[CAMPAIGN.index("records:") :].replace("FILE", "cut.csv"), "records: []\n"),
        REFUSED,
    ),
    **{
        f"campaign: sampling_rate {value[:20]}": (_changed("12800 Hz", value), REFUSED)
        for value in ("0 Hz", "nan Hz", ".inf", "-1 Hz", "inf Hz", "fast", "1e400 Hz", "[1, 2]")
    },
    "campaign: sampling_rate 1e300 Hz": (_changed("12800 Hz", "1e300 Hz"), REFUSED),
    "campaign: sampling_rate 1e-300 Hz": (_changed("12800 Hz", "1e-300 Hz"), REFUSED),
    **{
        f"campaign: scale {value}": (_changed("unit: um", f"unit: um, scale: {value}"), REFUSED)
        for value in (".nan", ".inf", "big", "0", "1e400", "[1]", "true")
    },
    "campaign: scale 1e299": (_changed("unit: um", "unit: um, scale: 1e299"), EITHER),
    "campaign: scale 1e-299": (_changed("unit: um", "unit: um, scale: 1e-299"), EITHER),
    **{
        f"campaign: spindle_speed {value}": (_changed("3810 rpm", value), REFUSED)
        for value in ("0 rpm", "-1 rpm", "inf rpm", "nan rpm", "1e300 rpm", "1e-300 rpm")
    },
    **{
        f"campaign: feed {value}": (_changed("0.1 mm/tooth", value), REFUSED)
        for value in ("inf mm/tooth", "-1 mm/rev", "0 mm/min")
    },
    "campaign: feed 1e300": (_changed("0.1 mm/tooth", "1e300 mm/tooth"), EITHER),
    "campaign: depth inf": (_changed("2 mm,", "inf mm,"), REFUSED),
    "campaign: from nan": (_changed("kind: cut", "from: .nan, kind: cut"), REFUSED),
    "campaign: from inf": (_changed("kind: cut", "from: .inf, kind: cut"), REFUSED),
    "campaign: to 1e300": (_changed("kind: cut", "to: 1e300, kind: cut"), EITHER),
    "campaign: from -1e300": (_changed("kind: cut", "from: -1e300, kind: cut"), EITHER),
    "campaign: skip_rows 1e18": (_changed("kind: cut", f"skip_rows: {10**18}, kind: cut"), REFUSED),
    "campaign: skip_rows of 5000 digits": (_changed("kind: cut", f"skip_rows: {'9' * DEEP}, kind: cut"), REFUSED),
    "campaign: a delimiter of 5000 characters": (_changed("kind: cut", f"delimiter: '{'x' * DEEP}', kind: cut"), EITHER),
    "campaign: an empty delimiter": (_changed("kind: cut", "delimiter: '', kind: cut"), EITHER),
    "campaign: a column of 5000 characters": (_changed("column: disp", f"column: {'n' * DEEP}"), REFUSED),
    "campaign: a column of 1e300": (_changed("column: disp", f"column: {10**300}"), REFUSED),
    "campaign: a unit of 5000 characters": (_changed("unit: um", f"unit: {'m' * DEEP}"), REFUSED),
    "campaign: a channel of 5000 characters": (_changed("displacement:", f"{'d' * DEEP}:"), REFUSED),
    "campaign: a name of 5000 characters": (_changed("name: rig", f"name: {'n' * DEEP}"), EITHER),
    "campaign: a record's name of 5000 characters": (_changed("kind: cut", f"name: {'n' * DEEP}, kind: cut"), EITHER),
    "campaign: 20,000 records": (_changed(RECORD, "\n".join([RECORD] * 20_000)), EITHER),
    "campaign: a comment of 1.5 MB": (_changed("name:", "# " + "a b " * 375_000 + "\nname:"), EITHER),
    "campaign: flutes 1e9": (_changed("kind: cut", "flutes: 1000000000, kind: cut"), REFUSED),
    "scenario: a comment of 1.5 MB": (_changed("name:", "# " + "a b " * 375_000 + "\nname:", SCENARIO), EITHER),
    "scenario: 1e12 revolutions": (_changed("40 rev", f"{10**12} rev", SCENARIO), REFUSED),
    "scenario: 1e300 revolutions": (_changed("40 rev", "1e300 rev", SCENARIO), REFUSED),
    "scenario: -1 revolutions": (_changed("40 rev", "-1 rev", SCENARIO), REFUSED),
    "scenario: depth inf": (_changed("2 mm", "inf mm", SCENARIO), REFUSED),
    "scenario: feed nan": (_changed("0.1 mm/tooth", "nan mm/tooth", SCENARIO), REFUSED),
    "scenario: speed 1e300 rpm": (_changed("3810 rpm", "1e300 rpm", SCENARIO), REFUSED),
    "scenario: speed 1e-300 rpm": (_changed("3810 rpm", "1e-300 rpm", SCENARIO), REFUSED),
    "scenario: seed -1": (_changed("seed: 1", "seed: -1", SCENARIO), REFUSED),
    "scenario: seed of 5000 digits": (_changed("seed: 1", f"seed: {'9' * DEEP}", SCENARIO), REFUSED),
    "scenario: a name of 5000 characters": (_changed("small", "n" * DEEP, SCENARIO), EITHER),
    "scenario: no tests": (
        _changed(SCENARIO[SCENARIO.index("tests:") : SCENARIO.index("sensors:")], "tests: []\n", SCENARIO),
        REFUSED,
    ),
    "scenario: bits 1e9": (_changed("bits: 16", "bits: 1000000000", SCENARIO), REFUSED),
    "scenario: noise inf": (_changed("noise: 0.5 um", "noise: inf um", SCENARIO), REFUSED),
    "scenario: range 0": (_changed("range: 1 mm", "range: 0 mm", SCENARIO), REFUSED),
    "scenario: sampling_rate 1e300 Hz": (_changed("12800 Hz", "1e300 Hz", SCENARIO), REFUSED),
    "scenario: sampling_rate 1e-300 Hz": (_changed("12800 Hz", "1e-300 Hz", SCENARIO), REFUSED),
    "scenario: mass 0": (_changed("2.573 kg", "0 kg", SCENARIO), REFUSED),
}
