"""An effect file written from a formula that was found in measurements: ready for the catalogue, and to be edited.

A formula is a sum of terms. Each term is a place on the regenerative loop (a hook), an expression of what that hook
offers, and a coefficient, which becomes a parameter of the effect.
"""

from __future__ import annotations

import keyword
import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from testbed.catalogue import catalogue
from testbed.effect import HOOKS
from testbed.problem import InputProblem
from testbed.system.atomic import write_text

HOOK_ORDER = ("structure_force", "structure_force_y", "tangential_force", "normal_force")
SPAN = 1e3  # bounds of a coefficient, in times its found value
SYMBOLS = {"structure_force": "F", "structure_force_y": "F_y", "tangential_force": "F_t", "normal_force": "F_n"}


@dataclass(frozen=True)
class ForceTerm:
    """One term of a force law: its coefficient's name and unit, the hook, the law as text and as a Python expression.

    The expression may use what the hook offers (see `testbed effects --hooks`), numbers, `abs` and the math module.
    complexity counts what a reader has to take in: 1 for a single power.
    """

    name: str
    hook: str
    law: str
    expression: str
    unit: str
    meaning: str
    complexity: float = 1.0

    @property
    def arguments(self) -> tuple[str, ...]:
        """The hook's quantities that the expression uses."""
        words = set(re.findall(r"[a-z_]+", self.expression))
        return tuple(offer for offer in HOOKS[self.hook].offers if offer in words)


@dataclass(frozen=True)
class Coefficient:
    """A term with the value found for it and its 95 % interval, in the term's unit."""

    term: ForceTerm
    value: float
    low: float
    high: float


_HEAD = '''"""{title}: a force law read off measurements, to be checked and edited.

{laws}

{story}

Source: sparse regression on the force that the model lacked; no textbook stands behind it. The intervals are those of the
search; `testbed add` refits everything and gives the ones to quote.
{found}

Valid: within the amplitudes, speeds, depths and feeds it was found on; there it explained {share:.0%} of the misfit
{where}.

Start of a fit: the values found, which are the examples below.
"""

'''

_CARD = """from testbed.effect import Effect, Parameter

EFFECT = Effect(
    title="{title}",
    parameters=(
{parameters}    ),
    law="{law}",
    source="sparse regression on the missing force of a campaign",
    validity="the amplitudes, speeds, depths and feeds it was found on",
    leaves="the misfit of the campaign that it was read off",
)
"""

_PARAMETER = """        # found: {value:.4g}, 95 % interval {low:.4g} to {high:.4g}
        Parameter("{name}", "{name}", "{unit}", "{meaning}",
                  neutral=0.0, bounds=(-{bound}, {bound}), example={example}, start={example}),
"""


def checked_name(folder: Path, name: str) -> Path:
    """Where the file goes. InputProblem where the name is none for an effect, or taken."""
    if not name.isidentifier() or keyword.iskeyword(name) or name.startswith(("_", "test_")) or name == "chain":
        raise InputProblem(name, "is no name for an effect", "use letters, digits and _, a letter first")
    if folder.exists() and not folder.is_dir():
        raise InputProblem(folder, "is a file", "name a folder to write the proposal into")
    if name in catalogue():
        raise InputProblem(name, "is an effect of the catalogue", "choose another name")
    path = folder / f"{name}.py"
    if path.exists():
        raise InputProblem(path, "exists already", "choose another name, or remove it")
    return path


def free_name(folder: str | Path, name: str = "proposal") -> str:
    """The name itself, or with the first number behind it that is not taken in the folder or the catalogue."""
    taken = {*catalogue(), *(path.stem for path in Path(folder).glob("*.py"))}
    count, chosen = 1, name
    while chosen in taken:
        count += 1
        chosen = f"{name}_{count}"
    return chosen


def effect_text(name: str, coefficients: Sequence[Coefficient], share: float, story: str, *, held_out: bool = True,
                switched: bool = False) -> str:  # fmt: skip
    """The text of an effect file for a formula. ValueError where there is nothing to write.

    share: of the misfit that it explains, on operating conditions held out of the regression where `held_out`. switched:
    every term is passed over while its coefficient is zero, for a law of many terms of which few are in use.
    """
    if not coefficients:
        raise ValueError("a formula without terms is no effect")
    if len({one.term.name for one in coefficients}) < len(coefficients):
        raise ValueError("two terms of one name")
    laws = {}
    for hook in HOOK_ORDER:
        terms = [one.term for one in coefficients if one.term.hook == hook]
        if terms:
            laws[hook] = f"{SYMBOLS[hook]} = " + _joined([_signed(term.name, term.law) for term in terms])
    values = "\n".join(
        f"    {one.term.name} = {one.value:.5g} {one.term.unit} (95 %: {one.low:.4g} to {one.high:.4g})" for one in coefficients
    )
    title = name.replace("_", " ").capitalize()
    head = _HEAD.format(
        title=title,
        laws="\n".join(f"    {law}" for law in laws.values()),
        story=textwrap.fill(story.replace('"', "'").replace("\\", "/"), 118),
        share=min(max(share, 0.0), 1.0),
        found=values,
        where="on operating conditions held out of the regression" if held_out else "in the regression itself",
    )
    functions = [_function(hook, [one.term for one in coefficients if one.term.hook == hook], switched) for hook in laws]
    uses_math = "import math\n\n" if any("math." in text for text in functions) else ""
    card = _CARD.format(
        title=title,
        parameters="".join(_parameter(one) for one in coefficients),
        law="; ".join(laws.values()),
    )
    return head + uses_math + card + "".join(functions)


def _signed(name: str, law: str) -> str:
    return f"-{name} {law[1:]}" if law.startswith("-") else f"{name} {law}".rstrip()


def _joined(parts: Sequence[str]) -> str:
    text = " + ".join(parts)
    return text.replace("+ -", "- ")


def _parameter(one: Coefficient) -> str:
    if one.value == 0.0 or not math.isfinite(one.value):
        raise ValueError(f"the coefficient of {one.term.law} was not found")
    return _PARAMETER.format(
        value=one.value, low=one.low, high=one.high, name=one.term.name, unit=one.term.unit, meaning=one.term.meaning,
        bound=_number(SPAN * abs(one.value), 2), example=_number(one.value, 6),
    )  # fmt: skip


def _number(value: float, digits: int) -> str:
    """A float as Python text of so many digits."""
    text = f"{value:.{digits}g}"
    return text if "e" in text or "." in text else f"{text}.0"


def _function(hook: str, terms: Sequence[ForceTerm], switched: bool) -> str:
    offers = HOOKS[hook].offers
    used = {argument for term in terms for argument in term.arguments}
    contact = hook in ("tangential_force", "normal_force")
    if contact:
        used |= {"chip", "penetration"}
    arguments = [offer for offer in offers if offer in used] + [term.name for term in terms]
    lines = ["", "", f"def {hook}({', '.join(arguments)}):"]
    if contact:
        lines += ["    if chip > penetration + 1e-12:  # contact_loss has the edge in the air", "        return 0.0"]
    parts = [f"-{t.name} * {t.expression[1:]}" if t.expression.startswith("-") else f"{t.name} * {t.expression}" for t in terms]
    if len(parts) == 1:
        lines.append(f"    return {parts[0]}")
        return "\n".join([*lines, ""])
    added = [f"force -= {part[1:]}" if part.startswith("-") else f"force += {part}" for part in parts]
    if switched:
        lines.append("    force = 0.0")
        for term, line in zip(terms, added, strict=True):
            lines += [f"    if {term.name} != 0.0:", f"        {line}"]
    else:
        lines.append(f"    force = {parts[0]}")
        lines += [f"    {line}" for line in added[1:]]
    lines.append("    return force")
    return "\n".join([*lines, ""])


def write_proposal(coefficients: Sequence[Coefficient], folder: str | Path, name: str, *, share: float, story: str,
                   held_out: bool = True) -> Path:  # fmt: skip
    """Write NAME.py (see `effect_text`) into a folder (made where there is none) and return its path.

    InputProblem where that cannot be.
    """
    place = Path(folder)
    path = checked_name(place, name)
    text = effect_text(name, coefficients, share, story, held_out=held_out)
    try:
        place.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise InputProblem(place, f"cannot be made ({problem.strerror})", "choose another place") from None
    write_text(path, text)
    return path
