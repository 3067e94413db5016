"""A machine in a cut as a delay equation in the spindle angle, as the effects' own files have it.

    dY/dphi = f(phi, Y(phi), Y(phi - pitch)),    Y = [q, q', t, states of the active effects, further modes]

q is the motion of the structure's first mode. The delay is one pitch of spindle angle whatever the speed does.
`testbed.analysis.linear.linearise` finds its multipliers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import numpy as np

from testbed.catalogue import catalogue as known_effects
from testbed.cut import Cut
from testbed.effect import Effect
from testbed.engines import fast_kernel as fk
from testbed.engines import loop_kernel as lk
from testbed.engines.compose import Layout, compose
from testbed.engines.model_arrays import active_effects, state_place
from testbed.engines.packing import Packed, pack
from testbed.engines.stiffening import fastest_frequency
from testbed.machine import Model

TIME = 2  # the place of the time in the state


@dataclass(frozen=True)
class Rates:
    """f (n, K), its derivatives `now` by Y(phi) and `before` by Y(phi - pitch), (n, K, K), at n phases.

    speed (n,) rad/s; lost (n,): a tooth there has left the cut, so that more than one delay acts.
    """

    f: np.ndarray
    now: np.ndarray
    before: np.ndarray
    speed: np.ndarray
    lost: np.ndarray


@dataclass(frozen=True)
class RegenerativeLoop:
    """The delay equation of one machine at one cut.

    unknowns (K,): places in the whole state (of `size`) of the coordinates that move; prescribed (K,): those that set
    the spindle speed, taken as a given course when the motion is perturbed. breaks: phases from 0 to the pitch (rad)
    between which f is smooth; teeth: how many teeth may be in the cut there. fastest: highest angular frequency, rad/s.
    steady: the speed is constant. passes_a_turn: tooth passes until the same tooth returns, 1 where teeth are alike.
    """

    packed: Packed
    kernel: ModuleType
    unknowns: np.ndarray
    prescribed: np.ndarray
    breaks: np.ndarray
    teeth: np.ndarray
    pitch: float
    nominal_speed: float
    fastest: float
    steady: bool
    passes_a_turn: int

    @property
    def size(self) -> int:
        """Length of the whole state."""
        return self.packed.Y.size

    def rates(self, phases: np.ndarray, pass_number: int, teeth: int, states: np.ndarray, pasts: np.ndarray,
              scale: np.ndarray | None = None) -> Rates:
        """Rates at `phases` (n,) of a pass, for whole states and states one pitch ago, both (n, size).

        scale (K,): half-widths of the differences; without it the derivatives are left empty.
        """
        count = phases.size
        kept = self.unknowns if scale is not None else self.unknowns[:0]
        size = kept.size
        out = Rates(np.empty((count, size)), np.empty((count, size, size)), np.empty((count, size, size)),
                    np.empty(count), np.empty(count, dtype=np.bool_))
        one = self.packed
        self.kernel.linearise(one.A, one.P, one.G, np.ascontiguousarray(phases), pass_number, teeth,
                              states.copy(), pasts.copy(), kept, np.empty(0) if scale is None else scale, out.f,
                              out.now, out.before, out.speed, out.lost)
        return out


def regenerative_loop(model: Model, cut: Cut, catalogue: Mapping[str, Effect] | None = None) -> RegenerativeLoop:
    """The delay equation of `model` at `cut`. ValueError where the model has no cutter, or an effect no linear answer."""
    if model.cutter is None:
        raise ValueError("the model has no cutter: nothing is cut")
    effects = known_effects() if catalogue is None else catalogue
    packed, layout = pack(model, cut, effects), Layout(effects)
    if model.cutter.pitch_angles:
        raise ValueError("teeth of unequal pitch have several delays, and with effects only one is linearised")
    active = active_effects(model, effects)
    for name in active:
        if effects[name].no_linear_answer:
            raise ValueError(effects[name].no_linear_answer)
    further = [state_place(effects, f"modes[{mode}].displacement") for mode in range(1, len(model.structure.modes))]
    unknowns = [0, 1, *(place + order for place in further for order in (0, 1))]
    prescribed = [False] * len(unknowns)
    for name in active:
        for state in effects[name].states:
            unknowns.append(layout.state[name, state])
            prescribed.append("speed" in effects[name].hooks)
    uneven = model.cutter.flutes > 1 and any("edge_position" in effects[name].hooks for name in active)
    segments = packed.I[fk.SEGMENTS]
    breaks = packed.G[lk.CORNERS : lk.CORNERS + segments + 1].copy()
    teeth = packed.I[fk.TEETH : fk.TEETH + segments].copy()
    kernel = compose(effects, ("array_kernel", "plane_kernel", "loop_kernel", "linearised_kernel"), packed.planar)
    return RegenerativeLoop(
        packed, kernel, np.array(unknowns), np.array(prescribed), breaks, teeth, float(packed.G[lk.PITCH]), cut.spindle_speed,
        fastest_frequency(model, effects), bool(packed.I[fk.STEADY_SPEED]), model.cutter.flutes if uneven else 1)
