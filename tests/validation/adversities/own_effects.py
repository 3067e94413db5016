"""Own effects whose law is wrong, never ends, or is no law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.validation.adversities.probe import CAMPAIGN, TABLE, Make, Probe
from tests.validation.adversities.runner import EITHER

LAW = '''"""A law."""
import math
from testbed.effect import Effect, Parameter

EFFECT = Effect(title="A law", law="F = c v", source="nobody", validity="none", leaves="nothing",
                parameters=(Parameter("strength", "c", "N s/m", "how strong", 0.0, (0.0, 1e4), 1.0), ),
                confused_with=(("process_damping", "a shallow cut"), ))


def structure_force(velocity, strength):
    LINE
'''


def _law(line: str, *command: str, beside: str = "", text: str = LAW) -> Make:
    def make(folder: Path) -> Sequence[object]:
        (folder / "own").mkdir()
        (folder / "own" / "law.py").write_text(text.replace("LINE", line))
        (folder / "own" / "beside.py").write_text(beside) if beside else None
        (folder / "precious").write_text("kept")
        (folder / "cut.csv").write_text(TABLE)
        (folder / "campaign.yaml").write_text(CAMPAIGN.replace("FILE", "cut.csv"))
        rest = {
            "effects": ("law",),
            "add": ("law", "-m", "model.yaml", "-c", "campaign.yaml", "-o", "new.yaml"),
            "diagnose": ("campaign.yaml", "-m", "model.yaml"),
        }[command[0]]
        return (*command, *rest, "--effects", "own", *(("--no-picture",) if command[0] == "effects" else ()))

    return make


BAD_LAWS = {
    "nan": "return math.nan * strength",
    "nan beside its neutral value": "return velocity * strength / (strength - strength) if strength > 0.0 else 0.0",
    "raises": "return 1 // int(velocity * 0.0)",
    "raises for a strength": "return strength / (velocity * 0.0)",
    "never ends": "while strength > 0.0:\n        velocity += 0.0\n    return 0.0",
    "never ends at all": "while True:\n        pass",
    "recurses": "return structure_force(velocity, strength)",
    "infinite": "return strength * math.inf",
    "text": "return 'a'",
}
DELETES = "from pathlib import Path\nPath('precious').unlink()\n"


def probes() -> Iterator[Probe]:
    for name, line in BAD_LAWS.items():
        for command in ("effects", "add", "diagnose"):
            yield Probe("own effects", f"{command}: {name}", _law(line, command))
    for name, text in {
        "never ends when read": "while True:\n    pass\n",
        "exits when read": "import os\nos._exit(0)\n",
        "kills when read": "import os\nos.kill(os.getpid(), 9)\n",
        "fills the memory": "x = [0] * 10**11\n",
    }.items():
        yield Probe("own effects", f"effects: {name}", _law("return strength * velocity", "effects", text=text + LAW))
    yield Probe(
        "own effects",
        "a script beside it deletes a file",
        _law("return strength * velocity", "effects", beside=DELETES),
        EITHER,
    )
