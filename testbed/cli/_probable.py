"""What `chart` and `plan` share: what is known of a machine, from its file or a campaign, and chances from machines drawn."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import click

from testbed.cli._answer import Answer, progress, shown
from testbed.problem import InputProblem

# seconds a cell, rounded up: one mode along the feed, a machine in x and y, a loop with effects
COST_S, PLANAR_COST_S, EFFECTS_COST_S = 1.5e-5, 2e-3, 25e-3
MOST_S, WORTH_SAYING_S = 3600.0, 60.0


class _Risk(click.ParamType):
    """A chance between 0 and 1, or in percent."""

    name = "chance"

    def convert(self, value: Any, parameter: click.Parameter | None, context: click.Context | None) -> float:
        """The chance; click's error where it is none."""
        from testbed.units import UnitProblem, parse_quantity

        try:
            risk = parse_quantity(value, "1")
        except UnitProblem as problem:
            self.fail(str(problem), parameter, context)
        if not 0.0 < risk < 1.0:
            self.fail(f"'{value}' is no chance between 0 and 100 %: give for example 5%", parameter, context)
        return risk


RISK = _Risk()


@dataclass(frozen=True)
class Asked:
    """A question for chances: the model and its file, the campaign's or None, effects, the grid, and how to draw."""

    model: Any
    model_file: str
    campaign: str | None
    catalogue: Any
    speeds: Any
    depths: Any
    draws: int
    seed: int
    risk: float
    quiet: bool


@dataclass(frozen=True)
class Sure:
    """Its answer: the machine in the middle, what is known of it, chances and the cut recommended; or why there are none."""

    draws: int
    risk: float
    model: Any = None
    known: Any = None
    chance: Any = None
    recommended: Any = None
    why_none: str | None = None
    drawn: tuple[dict[str, Any], ...] = ()
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The keys that chances add to a chart's answer."""
        chance = self.chance
        limits = [None] * 3 if chance is None else list(chance.limits)
        lies = [None] * 3 if chance is None else [list(one) for one in chance.lies]
        named = {f"stability_limit_{name}": one for name, one in zip(("low", "median", "high"), limits, strict=True)}
        named |= {f"stability_limit_{name}_lies": one for name, one in zip(("low", "median", "high"), lies, strict=True)}
        return {"stable_probability": None if chance is None else chance.probability, **named,
                "recommended": self.recommended, "risk": self.risk, "draws": None if chance is None else chance.draws,
                "drawn": list(self.drawn), "no_chance": self.why_none}


def unasked(draws: int, risk: float) -> Sure:
    """The answer where nobody asked for chances."""
    return Sure(draws, risk, why_none="no value of the model has a deviation, and no campaign was given")


def chances(asked: Asked) -> Sure:
    """The chances of all cells. InputProblem where they would take too long."""
    sure = _from_campaign(asked) if asked.campaign else _from_file(asked)
    if sure.known is None:
        return sure
    return with_chances(sure, asked)


def with_chances(sure: Sure, asked: Asked) -> Sure:
    """The answer with the chances of all cells, from machines drawn from what is known."""
    from testbed.analysis.probable.chance import by_surface, chance_of, charts_on_surface, each_drawn
    from testbed.analysis.probable.draws import NoDraws

    notes = list(sure.notes)
    known, left_out = linear_where_it_can(sure.known)
    with_effects = bool(known.model.effects)
    charts = charts_on_surface(known) if with_effects else asked.draws
    cost = EFFECTS_COST_S if with_effects else PLANAR_COST_S if _in_plane(known) else COST_S
    seconds = cost * charts * asked.speeds.size * asked.depths.size
    if seconds > MOST_S:
        most = MOST_S / (cost * charts)
        raise InputProblem(asked.model_file, f"{charts} charts of {asked.speeds.size} x {asked.depths.size} cells would take "
                           f"some {seconds / 3600:.0f} h", f"give at most {most:.0f} cells"
                           + ("" if with_effects else ", or fewer --draws"))
    if seconds > WORTH_SAYING_S and not asked.quiet:
        click.echo(f"{charts} charts, about {seconds / 60:.0f} min of processor time", err=True)
    if with_effects:
        notes.append("chances with effects: the modulus is computed along the principal axes of what is known and summed, an "
                     "approximation where another multiplier takes over within the spread")
    road: Any = by_surface if with_effects else each_drawn
    fill: Callable[..., Any] = partial(filled, catalogue=asked.catalogue)
    try:
        with progress("machines drawn", asked.quiet) as show:
            found = chance_of(road(fill, known, asked.speeds, asked.depths, asked.draws, asked.seed, show))
    except NoDraws as problem:
        return replace(sure, why_none=str(problem), notes=(*notes, f"no chance is given: {problem}"))
    notes += [left_out] if left_out else []
    notes += _of_blanks(found)
    best = found.recommended(asked.risk)
    if best is not None and best.axial_depth_of_cut == asked.depths[-1]:
        notes.append("the cut recommended is the deepest of the chart: a deeper one may remove more")
    return replace(sure, chance=found, recommended=best, notes=tuple(notes))


def linear_where_it_can(known: Any) -> tuple[Any, str]:
    """What is known without loss of contact, which the linear answer does not need where it is the only effect, and a note."""
    if set(known.model.effects) != {"contact_loss"}:
        return known, ""
    return replace(known, model=known.model.without_effect("contact_loss")), \
        "chances are for teeth that stay in the work: contact_loss is left out of them"


def filled(model: Any, speeds: Any, depths: Any, catalogue: Any) -> Any:
    """The chart of a machine, with effects or without; of a law without periodic motion all cells are blank."""
    import numpy as np

    from testbed.analysis.linear.stability import StabilityChart, stability_chart
    from testbed.cli.chart import with_effects

    if not model.effects:
        return stability_chart(model, speeds, depths)
    try:
        return with_effects(model, speeds, depths, catalogue, True)
    except InputProblem:
        nothing = np.full((depths.size, speeds.size), np.nan)
        return StabilityChart(speeds, depths, nothing + 0j, np.full(nothing.shape, -1, dtype=np.int8), nothing)


def _in_plane(known: Any) -> bool:
    return known.model.planar or "direction" in known.paths


def _from_file(asked: Asked) -> Sure:
    from testbed.analysis.probable.draws import of_spreads

    known = of_spreads(asked.model, asked.catalogue)
    note = f"chances: {asked.draws} machines drawn from the deviations in {asked.model_file}, each value by itself"
    return Sure(asked.draws, asked.risk, asked.model, known, drawn=_drawn(known, asked.catalogue), notes=(note,))


def _from_campaign(asked: Asked) -> Sure:
    """What the campaign's records tell, after the fit that `compare` makes."""
    from testbed.analysis.comparison.compare import compare
    from testbed.analysis.probable.posterior import posterior, why_no_chance
    from testbed.cli._fitting import engine_of, notes_on, read_both, sign_of_life

    assert asked.campaign is not None
    believed, records, read = read_both(asked.campaign, asked.model_file, asked.catalogue)
    if not any(record.kind == "cut" for record in records):
        raise InputProblem(asked.campaign, "holds no cut", "record a cut: nothing else tells of the cutting coefficients")
    with sign_of_life("fitting the believed model to all records", asked.quiet):
        found = compare(engine_of(asked.catalogue), records, believed, asked.catalogue)
        why = why_no_chance(found)
        if why:
            return Sure(asked.draws, asked.risk, why_none=why,
                        notes=(f"no chance is given, and the chart is that of {asked.model_file} as it stands: {why}",))
        told = posterior(found.fitter, found.fit, found.parameters, believed, asked.catalogue)
    model = replace(told.known.model, spreads=(), not_determined=told.given)
    notes = [*notes_on(read, believed), f"the chart is that of the machine fitted to {asked.campaign}, and its chances come "
             f"from {asked.draws} machines drawn from the fit, correlations and all"]
    kept = [path for path, _ in believed.spreads if path not in told.known.paths]
    if kept:
        notes.append(f"{', '.join(kept)}: the records were fitted with the value as believed, whose deviation is left out")
    return Sure(asked.draws, asked.risk, model, replace(told.known, model=model), drawn=_drawn(told.known, asked.catalogue),
                notes=tuple(notes))


def _drawn(known: Any, catalogue: Any) -> tuple[dict[str, Any], ...]:
    """Every parameter that is drawn, with its value, deviation and unit."""
    from testbed.analysis.probable.draws import unit_of

    rows = zip(known.paths, known.middle.tolist(), known.deviations.tolist(), strict=True)
    return tuple({"parameter": path, "value": value, "standard_deviation": size, "unit": unit_of(path, catalogue)}
                 for path, value, size in rows)


def _of_blanks(found: Any) -> list[str]:
    import numpy as np

    notes = []
    if nowhere := int(np.count_nonzero(np.isnan(found.probability))):
        notes.append(f"{nowhere} cells have no chance: too many of the machines drawn have no multipliers there")
    elif found.unknown.any():
        notes.append(f"of up to {found.unknown.max():.1%} of the machines drawn a cell's multipliers are unknown: they do not "
                     "count there")
    return notes


def said_chances(answer: Answer, sure: Sure) -> None:
    """What was drawn, and the cut recommended, for people."""
    answer.table(("drawn", "value", "standard deviation"),
                 [(one["parameter"], shown(one["value"], one["unit"]), shown(one["standard_deviation"], one["unit"], 3))
                  for one in sure.drawn])
    best = sure.recommended
    if best is None:
        answer.say(f"no cut of the chart is stable at a risk of {sure.risk:.3g}, as far as {sure.draws} machines tell")
        return
    answer.say(f"most removal at a risk of at most {sure.risk:.3g}: {best.spindle_speed * 30 / math.pi:.0f} rpm, "
               f"{best.axial_depth_of_cut * 1e3:.4g} mm, stable in {best.stable_probability:.1%} of the machines")
