"""What `chart` and `plan` share: what is known of a machine, from its file or a campaign, and chances from machines drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from testbed.api.believed import CampaignLike, ModelLike, in_the_work, name_of
from testbed.api.watch import Watch
from testbed.api.words import shown
from testbed.problem import InputProblem

# seconds a cell, rounded up: one mode along the feed, a machine in x and y, either as a loop with effects
COST_S, PLANAR_COST_S, EFFECTS_COST_S, PLANAR_EFFECTS_COST_S = 1.5e-5, 2e-3, 25e-3, 0.25
MOST_S, WORTH_SAYING_S = 3600.0, 60.0


@dataclass(frozen=True)
class Asked:
    """A question for chances: the model and how it was given, the campaign or None, effects, the grid, and how to draw."""

    model: Any
    model_file: ModelLike
    campaign: CampaignLike | None
    catalogue: Any
    speeds: Any
    depths: Any
    draws: int
    seed: int
    risk: float
    watch: Watch

    @property
    def model_name(self) -> str:
        """The model's for messages."""
        return name_of(self.model_file)

    @property
    def campaign_name(self) -> str:
        """The campaign's for messages."""
        return "" if self.campaign is None else name_of(self.campaign)


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
    model, left_out = in_the_work(sure.known.model)
    known = replace(sure.known, model=model)
    with_effects = bool(known.model.effects)
    charts = charts_on_surface(known) if with_effects else asked.draws
    costs = (COST_S, EFFECTS_COST_S) if not _in_plane(known) else (PLANAR_COST_S, PLANAR_EFFECTS_COST_S)
    cost = costs[with_effects]
    seconds = cost * charts * asked.speeds.size * asked.depths.size
    if seconds > MOST_S:
        most = MOST_S / (cost * charts)
        raise InputProblem(asked.model_name, f"{charts} charts of {asked.speeds.size} x {asked.depths.size} cells would take "
                           f"some {seconds / 3600:.0f} h", f"give at most {most:.0f} cells"
                           + ("" if with_effects else ", or fewer --draws"))
    if seconds > WORTH_SAYING_S:
        asked.watch.warn(f"{charts} charts, about {seconds / 60:.0f} min of processor time")
    if with_effects:
        notes.append("chances with effects: the modulus is computed along the principal axes of what is known and summed, an "
                     "approximation where another multiplier takes over within the spread")
    road: Any = by_surface if with_effects else each_drawn
    fill: Callable[..., Any] = partial(filled, catalogue=asked.catalogue)
    try:
        with asked.watch.counted("machines drawn") as show:
            found = chance_of(road(fill, known, asked.speeds, asked.depths, asked.draws, asked.seed, show))
    except NoDraws as problem:
        return replace(sure, why_none=str(problem), notes=(*notes, f"no chance is given: {problem}"))
    notes += ["chances are for teeth that stay in the work: contact_loss is left out of them"] if left_out else []
    notes += _of_blanks(found)
    best = found.recommended(asked.risk)
    if best is not None and best.axial_depth_of_cut == asked.depths[-1]:
        notes.append("the cut recommended is the deepest of the chart: a deeper one may remove more")
    return replace(sure, chance=found, recommended=best, notes=tuple(notes))


def filled(model: Any, speeds: Any, depths: Any, catalogue: Any) -> Any:
    """The chart of a machine, with effects or without; of a law without periodic motion all cells are blank."""
    import numpy as np

    from testbed.analysis.linear.stability import StabilityChart, stability_chart
    from testbed.api.chart import with_effects

    if not model.effects:
        return stability_chart(model, speeds, depths)
    try:
        return with_effects(model, speeds, depths, catalogue, Watch())
    except InputProblem:
        nothing = np.full((depths.size, speeds.size), np.nan)
        return StabilityChart(speeds, depths, nothing + 0j, np.full(nothing.shape, -1, dtype=np.int8), nothing)


def _in_plane(known: Any) -> bool:
    return known.model.planar or "direction" in known.paths


def _from_file(asked: Asked) -> Sure:
    from testbed.analysis.probable.draws import of_spreads

    known = of_spreads(asked.model, asked.catalogue)
    note = f"chances: {asked.draws} machines drawn from the deviations in {asked.model_name}, each value by itself"
    return Sure(asked.draws, asked.risk, asked.model, known, drawn=_drawn(known, asked.catalogue), notes=(note,))


def _from_campaign(asked: Asked) -> Sure:
    """What the campaign's records tell, after the fit that `compare` makes."""
    from testbed.analysis.comparison.compare import compare
    from testbed.analysis.probable.posterior import posterior, why_no_chance
    from testbed.api.fitting import engine_of, notes_on, read_both

    assert asked.campaign is not None
    believed, records, read = read_both(asked.campaign, asked.model_file, asked.catalogue)
    if not any(record.kind == "cut" for record in records) and not {"tangential_coefficient"} & set(dict(believed.spreads)):
        raise InputProblem(asked.campaign_name, "holds no cut", "record one, or give the cutting coefficients a deviation in "
                           f"{asked.model_name} (550 +- 50 N/mm^2): nothing else tells of them")
    with asked.watch.busy("fitting the believed model to all records"):
        found = compare(engine_of(asked.catalogue), records, believed, asked.catalogue)
        why = why_no_chance(found)
        if why:
            return Sure(asked.draws, asked.risk, why_none=why,
                        notes=(f"no chance is given, and the chart is that of {asked.model_name} as it stands: {why}",))
        told = posterior(found.fitter, found.fit, found.parameters, believed, asked.catalogue)
    model = replace(told.known.model, spreads=(), not_determined=told.given)
    notes = [*notes_on(read, believed), f"the chart is that of the machine fitted to {asked.campaign_name}, and its chances "
             f"come from {asked.draws} machines drawn from the fit, correlations and all"]
    notes += of_beliefs(told, believed, asked.catalogue)
    return Sure(asked.draws, asked.risk, model, replace(told.known, model=model), drawn=_drawn(told.known, asked.catalogue),
                notes=tuple(notes))


def of_beliefs(told: Any, believed: Any, catalogue: Any) -> list[str]:
    """Lines on what the records do not tell: drawn as far as beliefs may be off, held, or with a deviation that is left out."""
    from testbed.analysis.probable.draws import unit_of
    from testbed.machine import base_parameter

    notes = [f"{path}: not determined by these records, and drawn about the value of the file with a standard deviation of "
             f"{shown(size, unit_of(path, catalogue), 3)}, as beliefs may be off; give its own there, a +- b"
             for path, size in told.assumed.items()]
    held = [path for path in told.given if path not in told.assumed]
    notes += [f"{', '.join(held)}: not determined by these records, and held as believed in all machines drawn"] if held else []
    left = [path for path, _ in believed.spreads if path not in told.known.paths]
    notes += [f"{', '.join(left)}: coefficients over masses are what the records tell and what counts, so that its deviation "
              "is left out"] if left else []
    silent = [path for path in believed.base_parameters if base_parameter(path) not in ("mass", "immersion")
              and path not in (*told.known.paths, *told.given)]
    return notes + ([f"{', '.join(silent)}: no record tells of it, and all machines drawn have it as the file has it; give it "
                     "a deviation there, a +- b"] if silent else [])


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
