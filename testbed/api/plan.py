"""The cuts worth making next: what each is expected to tell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from testbed.api.believed import CampaignLike, EffectsLike, ModelLike, effects_of, in_the_work, name_of
from testbed.api.chart import chance_of_chatter
from testbed.api.defaults import PLAN_DEPTHS, PLAN_SPEEDS
from testbed.api.fitting import engine_of, read_both
from testbed.api.probable import Asked, Sure, of_beliefs, with_chances
from testbed.api.quantity import DEPTH, SPEED, Quantities, Quantity, quantity
from testbed.api.result import Result, Table, shown_here
from testbed.api.watch import Progress, Watch
from testbed.api.words import shown
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbed.analysis.probable.plan import Planned

MOST_CUTS = 2_000


@dataclass(frozen=True, repr=False, eq=False)
class Plan(Result):
    """Cuts worth making next, the most telling first.

    next: each with spindle_speed (rad/s), axial_depth_of_cut (m), stable_probability, information (nats), what it separates and
    what it is expected to show. explanations: what the campaign leaves open. no_plan: why none is planned, else None.
    candidates: how many cuts were looked at. most_vibration: m, peak to peak, that a cut may be expected to have, or None.
    """

    next: tuple[Planned, ...]
    explanations: tuple[str, ...]
    no_plan: str | None
    risk: float
    draws: int
    candidates: int
    notes: tuple[str, ...] = ()
    most_vibration: float | None = None

    def plot(self) -> Figure:
        """The cuts over speed and depth, larger where they tell more."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(7, 4.5), layout="constrained")
        axes, most = figure.subplots(), max((one.information for one in self.next), default=1.0)
        axes.scatter([one.spindle_speed * 30 / math.pi for one in self.next],
                     [one.axial_depth_of_cut * 1e3 for one in self.next],
                     [30 + 270 * one.information / most for one in self.next], c="#2b7bba", alpha=0.7)
        for number, one in enumerate(self.next, 1):
            axes.annotate(str(number), (one.spindle_speed * 30 / math.pi, one.axial_depth_of_cut * 1e3), xytext=(8, 8),
                          textcoords="offset points")
        axes.set(xlabel="spindle speed [rpm]", ylabel="axial depth of cut [mm]", title=self._headline())
        return shown_here(figure)  # type: ignore[no-any-return]

    def _answer(self) -> Mapping[str, Any]:
        return {"next": [one.as_json() for one in self.next],
                "explanations": self.explanations, "no_plan": self.no_plan, "risk": self.risk,
                "most_vibration": self.most_vibration, "draws": self.draws, "candidates": self.candidates, "notes": self.notes}

    def _table(self) -> Table:
        names = ("spindle_speed", "axial_depth_of_cut", "stable_probability", "vibration", "information",
                 "information_per_minute")
        return Table("", {name: [getattr(one, name) for one in self.next] for name in names}
                     | {"separates": [", ".join(one.separates) for one in self.next]},
                     {"spindle_speed": "rad/s", "axial_depth_of_cut": "m", "vibration": "m"})

    def _headline(self) -> str:
        if self.no_plan is not None:
            return f"no cut is planned: {self.no_plan}"
        return f"{len(self.next)} of {self.candidates} cuts, stable at a risk of {self.risk:.3g}"


def plan(campaign: CampaignLike, model: ModelLike, speed: Quantities, depth: Quantities, *, risk: Quantity = 0.05,
         vibration: Quantity | None = None, draws: int = 300, count: int = 5, seed: int = 0, effects: EffectsLike = (),
         progress: Progress = None) -> Plan:
    """Rank the cuts within reach that are stable at the stated risk by what they are expected to tell in a minute of cutting.

    Fits the model as `compare` does; where that leaves more than noise, or comes to what no machine is, makes the diagnosis.
    After "unexplained" no cut is called safe, and none is planned.

    campaign: a campaign.yaml, or testbed.load of one. model: a model.yaml or a Model. speed: within reach,
    `"2500 rpm:4500 rpm"`, with `:COUNT` or without, or values in rad/s. depth: `"0.5 mm:4 mm"`, or in m. risk: of chatter
    that a cut may have. vibration: the most that a cut may be expected to vibrate, peak to peak, `"0.2 mm"` or in m; two
    standard deviations of what is known count. draws: machines drawn. count: how many cuts to give. effects: folders of one's
    own effects. progress: a function of (title, done, all), or False. Raises InputProblem.
    """
    with working(progress) as watch:
        speeds, depths = SPEED.values(speed, "speed", PLAN_SPEEDS), DEPTH.values(depth, "depth", PLAN_DEPTHS)
        if len(speeds) * len(depths) > MOST_CUTS:
            raise InputProblem("speed, depth", f"{len(speeds) * len(depths)} cuts", f"give at most {MOST_CUTS}")
        calm = None if vibration is None else quantity(vibration, "m", "vibration")
        if calm is not None and not calm > 0.0:
            raise InputProblem("vibration", f"'{vibration}' is not above 0", "give for example '0.2 mm'")
        found = _planned((campaign, model), (speeds, depths), (chance_of_chatter(risk), draws, seed, calm),
                         effects_of(effects).known, watch)
        return replace(found, next=found.next[:count])


def _planned(given: tuple[CampaignLike, ModelLike], reach: tuple[list[float], list[float]],
             how: tuple[float, int, int, float | None], catalogue: Any, watch: Watch) -> Plan:
    import numpy as np

    from testbed.analysis.probable.plan import plan as ranked
    from testbed.analysis.probable.plan import safe_cuts

    (campaign, model_given), (speeds, depths), (risk, draws, seed, calm) = given, reach, how
    model, records, _ = read_both(campaign, model_given, catalogue)
    cuts = [record for record in records if record.kind == "cut"]
    if not cuts:
        raise InputProblem(name_of(campaign), "holds no cut", "record one: what a cut shows is foretold from those there are")
    open_, why, beliefs = _explanations(engine_of(catalogue), records, model, catalogue, watch)
    nothing = Plan((), tuple(one.name for one in open_), why, risk, draws, len(speeds) * len(depths),
                   most_vibration=calm)
    if why is not None:
        return nothing
    asked = Asked(model, model_given, campaign, catalogue, np.array(speeds), np.array(depths), draws, seed, risk, watch)
    stable, notes = _stable(open_, asked)
    within = safe_cuts(stable, speeds, depths, draws, risk)
    with watch.counted("cuts foretold") as show:
        found = ranked(engine_of(catalogue), max(cuts, key=lambda one: one.samples), open_, within, show)
    kept = [one for one in found if calm is None or one.vibration <= calm]
    if calm is not None and len(kept) < len(found):
        notes.append(f"{len(found) - len(kept)} of the {len(found)} cuts that are stable at that risk may vibrate by more than "
                     f"{shown(calm, 'm')}: left out")
    return replace(nothing, next=tuple(kept), notes=(*beliefs, *notes))


def _explanations(engine: Any, records: Any, model: Any, catalogue: Any, watch: Watch
                  ) -> tuple[list[Any], str | None, list[str]]:  # fmt: skip
    """What the records leave open, each with what it would make of the machine; why nothing can be said; what was believed."""
    from testbed.analysis.comparison.compare import compare
    from testbed.analysis.fit.estimates import estimates
    from testbed.analysis.probable.plan import Explanation
    from testbed.analysis.probable.posterior import posterior, why_no_chance
    from testbed.analysis.search.diagnose import diagnose
    from testbed.analysis.search.ties import rivals_of

    with watch.busy("fitting the believed model to all records") as progress:
        found = compare(engine, records, model, catalogue)
        why = why_no_chance(found)
        if not why:
            told = posterior(found.fitter, found.fit, found.parameters, model, catalogue)
            return [Explanation("the model as it is", told.known, told.wider)], None, of_beliefs(told, model, catalogue)
        if found.says_nothing or found.adequate:
            return [], why, []
        diagnosis = diagnose(engine, records, model, catalogue, progress=progress)
        open_ = []
        for one in rivals_of(diagnosis):
            told = posterior(one.fitter, one.fit, estimates(one.fitter, one.fit, catalogue), model, catalogue)
            open_.append(Explanation(" + ".join(one.effects), told.known, told.wider))
    return open_, None if open_ else f"{diagnosis.verdict.replace('_', ' ')}: {diagnosis.sentence}", []


def _stable(open_: list[Any], asked: Asked) -> tuple[Any, list[str]]:
    """The chance of every cell over the explanations, all as likely, and notes: NaN where none is known of one of them.

    Where a law leaves no periodic motion to linearise about, and in x and y, where a loop with effects takes ten times as long,
    the machine without its effects counts.
    """
    import numpy as np

    total, notes = np.zeros((asked.depths.size, asked.speeds.size)), []
    for one in open_:
        known = replace(one.known, model=in_the_work(one.known.model)[0])
        if known.model.planar and known.model.effects:
            known = known.without_effects()
            notes.append(f"{one.name}: the chance is that of the machine without effects: with them it takes too long")
        sure = with_chances(Sure(asked.draws, asked.risk, known=known), replace(asked, model=known.model))
        if sure.chance is None:
            raise InputProblem(asked.campaign_name, f"of {one.name}, {sure.why_none}", "record more cuts")
        notes += [f"{one.name}: {note}" for note in sure.notes if "deepest" not in note]
        chance = sure.chance.probability
        if np.isnan(chance).any() and known.model.effects:
            linear = with_chances(Sure(asked.draws, asked.risk, known=known.without_effects()), asked).chance
            notes.append(f"{one.name}: where its loop is not linearised, the chance is that of the machine without it")
            chance = np.where(np.isnan(chance), linear.probability, chance)
        total += chance / len(open_)
    return np.nan_to_num(total), list(dict.fromkeys(notes))
