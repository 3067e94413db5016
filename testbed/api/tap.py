"""From hammer blows and frequency responses to the modes of a machine."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from testbed.api.believed import Effects, EffectsLike, File, ModelLike, effects_of, model_of
from testbed.api.places import check_place, page_place
from testbed.api.result import Result, Table, shown_here
from testbed.api.working import working
from testbed.problem import InputProblem

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from testbed.analysis.tap.result import BlowSeen, FoundMode, TapResult
    from testbed.analysis.tap.scales import ScaleCheck
    from testbed.files.taps_file import Taps
    from testbed.machine import Mode, Model

_MISTAKEN = 1.5  # times a believed frequency, within which a mode that rings may be the one believed in
_NAMES = ("natural_frequency", "damping_ratio", "mass", "direction")


@dataclass(frozen=True, repr=False, eq=False)
class TapTest(Result):
    """The modes that a tap test shows.

    detail: everything, the fits too. taps: what was read. base: the model whose cutter, cutting and effects the new one takes.
    """

    detail: TapResult
    taps: Taps
    base: Model | None
    effects: Effects
    place: str

    @property
    def modes(self) -> tuple[FoundMode, ...]:
        """Each mode: natural_frequency, damping_ratio, mass and direction with intervals, and what carries it (`on`)."""
        return self.detail.modes

    @property
    def residual(self) -> float:
        """Share of the measured responses that the modes leave unexplained."""
        return self.detail.residual

    @property
    def blows(self) -> tuple[BlowSeen, ...]:
        """Every blow: when, how hard, used or why not."""
        return self.detail.blows

    @property
    def scales(self) -> tuple[ScaleCheck, ...]:
        """What was measured twice, and whether it has one scale. None of them tells a factor common to all."""
        return self.detail.scales

    @property
    def notes(self) -> tuple[str, ...]:  # type: ignore[override]
        """What is to be known before the modes are believed."""
        return self.detail.notes

    @property
    def model(self) -> Model:
        """The machine of these modes. InputProblem where they make none, such as without a mass that the data tell."""
        return self._made[0]

    @property
    def guessed(self) -> tuple[str, ...]:
        """Paths of the model's parameters that are guesses: the data do not tell them."""
        return self.model.not_determined

    def save_model(self, path: File) -> Path:
        """Write the machine as a model.yaml, with the intervals found beside it; an older one there is replaced."""
        from testbed.files.model_file import write_model

        check_place(path)
        model, remarks = self._made
        write_model(model, Path(path), self.effects.known, remarks)
        return Path(path)

    def report(self, path: File) -> Path:
        """Write the page of this tap test into a folder (as report.html), or as the .html file named; returns its path."""
        from testbed.analysis.report.tap_page import tap_page

        return tap_page(self.detail, self.taps.name).write(page_place(path))

    def plot(self) -> Figure:
        """Measured and fitted responses over frequency, one below the other; without forces, the modes that ring."""
        import numpy as np
        from matplotlib.figure import Figure

        curves = [(one, group, place) for group in self.detail.groups for place, one in enumerate(group.responses)]
        figure = Figure(figsize=(9, 2.6 * max(1, len(curves))), layout="constrained")
        if not curves:
            axes = figure.subplots()
            axes.stem([one.natural_frequency.value for one in self.modes], [one.damping_ratio.value for one in self.modes])
            axes.set(xlabel="natural frequency [Hz]", ylabel="damping ratio [1]")
            return shown_here(figure)  # type: ignore[no-any-return]
        for axes, (one, group, place) in zip(figure.subplots(len(curves), 1, squeeze=False)[:, 0], curves, strict=True):
            mask, fitted, drawn = group.fit.lines.masks[place], group.fit.fitted()[place], group.drawn(place)
            axes.semilogy(one.frequency[drawn], np.abs(one.receptance[drawn]) * 1e6, color="#2b7bba", label="measured")
            axes.semilogy(one.frequency[mask], np.abs(fitted) * 1e6, color="#d1495b", label="fitted")
            axes.set(title=f"{one.name}, on the {one.on}", ylabel="receptance [um/N]")
            axes.legend(fontsize=8)
        axes.set_xlabel("frequency [Hz]")
        return shown_here(figure)  # type: ignore[no-any-return]

    @cached_property
    def _made(self) -> tuple[Model, list[str]]:
        return _model_of_the_modes(self.detail, self.base, self.place)

    def _answer(self) -> Mapping[str, Any]:
        found = self.detail
        return {"modes": [mode.as_json() for mode in found.modes], "residual": found.residual, "blows": found.blows,
                "responses": found.responses_json(), "decays": [one.as_json() for one in found.decays],
                "scales": [one.as_json() for one in found.scales], "notes": found.notes}

    def _table(self) -> Table:
        columns: dict[str, list[Any]] = {"mode": list(range(len(self.modes)))}
        for name in _NAMES:
            found = [getattr(mode, name) for mode in self.modes]
            columns |= {name: [one.value for one in found], f"{name}_low": [one.low for one in found],
                        f"{name}_high": [one.high for one in found]}
        units = {name + end: unit for name, unit in zip(_NAMES, ("Hz", "1", "kg", "rad"), strict=True)
                 for end in ("", "_low", "_high")}
        return Table("mode", columns | {"on": [mode.on for mode in self.modes]}, units)

    def _headline(self) -> str:
        used = sum(blow.used for blow in self.blows)
        blows = f", {used} of {len(self.blows)} blows used" if self.blows else ""
        return f"{len(self.modes)} modes, residual {self.residual:.1%}{blows}"


def tap(taps: File | Taps, *, model: ModelLike | None = None, modes: int | None = None, effects: EffectsLike = ()) -> TapTest:
    """Find the modes that a tap test shows: natural frequency, damping ratio, mass and direction, each with an interval.

    taps: a taps.yaml, or testbed.load of one. model: whose cutter, cutting and effects the new one takes over. modes: so many
    for each set of responses that belong together, instead of as many as the data ask for. effects: folders of one's own
    effects, which a model may have. Raises InputProblem. Needs the extra package sdypy-EMA.
    """
    from testbed.analysis.tap.tap import tap_test
    from testbed.files.taps_file import Taps, load_taps

    with working():
        own = effects_of(effects)
        base = None if model is None else model_of(model, own.known)[0]
        if isinstance(taps, Taps):
            read, place = taps, str(taps.file)
        else:
            read, place = load_taps(Path(taps)), os.fspath(taps)
        return TapTest(tap_test(read, modes), read, base, own, place)


def _model_of_the_modes(found: TapResult, base: Model | None, taps_file: str) -> tuple[Model, list[str]]:
    """(the model of the modes, with what a given model says of the cut, and remarks on it).

    InputProblem where a mode's values make none.
    """
    from testbed.machine import CUTTING, Model, Structure

    known = [(mode, mode.mode()) for mode in found.modes if mode.mass.determined]
    if any(check.agrees is False for check in found.scales):
        known = [(mode, mode.mode()) for mode in found.modes]  # with masses that are marked as guesses
    known = known or _with_believed_masses(found, base, taps_file)
    try:
        structure = Structure.of([mode for _, mode in known])
    except ValueError as problem:
        raise InputProblem(taps_file, f"the modes found make no machine ({problem})", "ask for fewer with --modes") from None
    model = Model(structure)
    if base is not None:
        spreads = tuple(one for one in base.spreads if one[0].partition(".")[0] in {*base.effects, *CUTTING})
        model = replace(base, structure=structure, machine=None, not_determined=(), spreads=spreads)
    paths = {(place, name): model.mode_path(place, name) for place in range(len(known)) for name in _NAMES}
    guessed = tuple(path for (place, name), path in paths.items()
                    if path in model.base_parameters and not getattr(known[place][0], name).determined)
    tapped = {path: (one.low, one.high) for (place, name), path in paths.items()
              if path in model.base_parameters and (one := getattr(known[place][0], name)).determined and one.high > one.low}
    left = [f"{mode.natural_frequency.value:.5g} Hz" for mode in found.modes if all(mode is not one for one, _ in known)]
    remarks = [f"found by testbed tap, residual {found.residual:.1%}", *found.notes]
    if left:
        remarks.insert(1, f"left out, without a mass: {', '.join(left)}")
    return replace(model, not_determined=guessed, tapped=tapped), remarks


def _with_believed_masses(found: TapResult, base: Model | None, taps_file: str) -> list[tuple[Any, Mode]]:
    """Modes of decays, each with the mass of the believed mode that lies nearest, or 1 kg without a model: a guess either way.

    InputProblem where no mode has one.
    """
    from testbed.machine import Mode

    believed, paired = list(base.structure.modes) if base is not None else [], []
    for mode in found.modes if found.decays else ():
        hertz, angle = mode.natural_frequency.value, mode.direction.value
        away = {one: abs(math.log(one.natural_frequency / hertz)) for one in believed
                if one.on == mode.on and abs(math.cos(one.direction - angle)) > math.sqrt(0.5)}
        own = min((one for one in away if away[one] < math.log(_MISTAKEN)), key=away.__getitem__, default=None)
        if own is not None:
            believed.remove(own)
        if own is not None or base is None:
            mass = own.mass if own is not None else 1.0
            paired.append((mode, Mode(mass, hertz, mode.damping_ratio.value, angle, mode.on)))
    if not paired:
        raise InputProblem(taps_file, "the data tell no mode's mass, so no machine can be written",
                           "tap where the sensor is, and measure the force" if not found.decays else
                           "measure the force, or give a model whose modes lie near those found, with their direction and `on`")
    return paired
