"""The library of terms from which a missing force is put together, and their values along a motion.

Every term is written once, as the expression that a proposed effect file will hold; here it is evaluated with numpy.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace

import numpy as np

from testbed.analysis.force.cut_variables import CellForce, Course, Edges, Trajectory
from testbed.trial.proposal import ForceTerm

ACROSS = 0.05  # complexity of a law along y beside the same along x: of one mode they are the same
HARMONICS = 6  # of the tooth angle
CREEP = 1e-3  # m/s, the velocity over which a change of sign is rounded
POWERS = {  # terms whose force is a power of a variable, with its sign
    "stiffness_2_odd": ("displacement", 2), "stiffness_3": ("displacement", 3), "stiffness_5": ("displacement", 5),
    "stiffness_7": ("displacement", 7), "damping_2": ("velocity", 2), "damping_3": ("velocity", 3),
}  # fmt: skip
_MATH = SimpleNamespace(cos=np.cos, sin=np.sin, tanh=np.tanh, sqrt=np.sqrt, copysign=np.copysign, pi=math.pi)


def structure_terms() -> list[ForceTerm]:
    """Laws of displacement x and velocity v on the structure; positive coefficients resist."""

    def term(name: str, law: str, expression: str, unit: str, meaning: str, complexity: float = 1.0) -> ForceTerm:
        return ForceTerm(name, "structure_force", law, expression, unit, meaning, complexity)

    x, v = "displacement", "velocity"
    return [
        term("stiffness_2", "-x^2", f"-{x} * {x}", "N/m^2", "quadratic stiffness, of one sign on both sides"),
        term("stiffness_2_odd", "-x |x|", f"-{x} * abs({x})", "N/m^2", "stiffness growing with the displacement", 1.2),
        term("stiffness_3", "-x^3", f"-{x} * {x} * {x}", "N/m^3", "cubic stiffness"),
        term("stiffness_4", "-x^4", f"-{x} * {x} * {x} * {x}", "N/m^4", "stiffness of fourth order", 1.3),
        term("stiffness_5", "-x^5", f"-{x} * {x} * {x} * {x} * {x}", "N/m^5", "quintic stiffness", 1.1),
        term("stiffness_7", "-x^7", f"-{x}**7", "N/m^7", "stiffness of seventh order", 1.4),
        term("friction", f"-tanh(v / {CREEP:g})", f"-math.tanh({v} / {CREEP!r})", "N", "friction of constant size"),
        term("damping_2", "-v |v|", f"-{v} * abs({v})", "N s^2/m^2", "damping by the square of the velocity"),
        term("damping_3", "-v^3", f"-{v} * {v} * {v}", "N s^3/m^3", "damping by the cube of the velocity"),
        term("damping_even", "-v^2", f"-{v} * {v}", "N s^2/m^2", "force by the square of the velocity, of one sign", 1.2),
        term("damping_x", "-x v", f"-{x} * {v}", "N s/m^2", "damping on one side of the displacement", 1.2),
        term("damping_abs_x", "-|x| v", f"-abs({x}) * {v}", "N s/m^2", "damping growing with the displacement", 1.3),
        term("damping_xx", "-x^2 v", f"-{x} * {x} * {v}", "N s/m^3", "damping by the square of the displacement", 1.1),
        term("inertia_xvv", "-x v^2", f"-{x} * {v} * {v}", "N s^2/m^3", "inertia that depends on the displacement", 1.4),
    ]


def planar_structure_terms() -> list[ForceTerm]:
    """The laws of `structure_terms` along x and, of y and its velocity, along y."""
    found = []
    for term in structure_terms():
        across = re.sub(r"\b(displacement|velocity)\b", r"\1_y", term.expression)
        law = re.sub(r"\bv\b", "v_y", re.sub(r"\bx\b", "y", term.law))
        found += [replace(term, name=f"{term.name}_x", meaning=f"{term.meaning}, along x"),
                  replace(term, name=f"{term.name}_y", hook="structure_force_y", law=law, expression=across,
                          meaning=f"{term.meaning}, along y", complexity=term.complexity + ACROSS)]
    return found


def power_term(variable: str, low: float, high: float) -> ForceTerm | None:
    """The term of the structure whose power of a variable lies between two exponents, if there is one."""
    within = (term for term in structure_terms() if term.name in POWERS and POWERS[term.name][0] == variable)
    return next((term for term in within if low <= POWERS[term.name][1] <= high), None)


def _tooth_laws(flutes: int) -> list[tuple[str, str, str, str, str, float]]:
    laws = [
        ("edge", "b", "depth", "N/m", "force a depth, whatever the chip", 1.0),
        ("edge_free", "", "1.0", "N", "force whatever depth and chip", 1.3),
        ("root", "b h^0.5", "depth * math.copysign(math.sqrt(abs(chip)), chip)", "N/m^1.5",
         "force by the root of the chip", 1.2),
        ("square", "b h^2", "depth * chip * chip", "N/m^3", "force by the square of the chip", 1.0),
        ("cube", "b h^3", "depth * chip * chip * chip", "N/m^4", "force by the cube of the chip", 1.2),
        ("rubbing", "b v_r / V", "depth * edge_velocity / cutting_speed", "N/m", "rubbing by the slope of the waves", 1.0),
        ("drag", "b v_r", "depth * edge_velocity", "N s/m^2", "force by the edge's velocity", 1.1),
        ("speed", "b h V", "depth * chip * cutting_speed", "N s/m^3", "chip force that grows with the speed", 1.2),
        ("wear", "b h l", "depth * chip * length_cut", "N/m^3", "chip force that grows with the length cut", 1.2),
        ("edge_wear", "b l", "depth * length_cut", "N/m^2", "edge force that grows with the length cut", 1.3),
        ("depth_chip", "b^2 h", "depth * depth * chip", "N/m^3", "chip force that grows with the depth", 1.3),
    ]  # fmt: skip
    for order in range(1, HARMONICS + 1):
        times = "angle" if order == 1 else f"{order}.0 * angle"
        mark = "theta" if order == 1 else f"{order} theta"
        for wave in ("cos", "sin"):
            laws.append((f"{wave}_{order}", f"b {wave}({mark})", f"depth * math.{wave}({times})", "N/m",
                         f"waveform of the tooth angle, order {order}", 1.4))  # fmt: skip
    for order in range(1, flutes // 2 + 1):
        turn = f"{order}.0 * 2.0 * math.pi * tooth / {flutes}.0"
        for wave in ("cos", "sin") if 2 * order < flutes else ("cos",):
            laws.append((f"tooth_{wave}_{order}", f"b {wave}({order} 2 pi i / {flutes})", f"depth * math.{wave}({turn})",
                         "N/m", "edge force that differs from tooth to tooth", 1.3))  # fmt: skip
            laws.append((f"chip_{wave}_{order}", f"b h {wave}({order} 2 pi i / {flutes})",
                         f"depth * chip * math.{wave}({turn})", "N/m^2", "chip force that differs from tooth to tooth",
                         1.3))  # fmt: skip
    return laws


def tooth_terms(flutes: int) -> list[ForceTerm]:
    """Laws of chip h, depth b, edge velocity v_r, cutting speed V, length cut l and tooth angle theta on a tooth."""
    return [
        ForceTerm(f"{name}_{side[0]}", f"{side}_force", law, expression, unit, f"{meaning}, {side}", complexity)
        for name, law, expression, unit, meaning, complexity in _tooth_laws(flutes)
        for side in ("tangential", "normal")
    ]


def _value(expression: str, known: dict[str, np.ndarray], size: int) -> np.ndarray:
    names = {"math": _MATH, "abs": np.abs, "__builtins__": {}}
    return np.broadcast_to(np.asarray(eval(expression, names, known), dtype=float), (size,))  # the library's own text


def term_value(term: ForceTerm, known: Mapping[str, float]) -> float:
    """A term with the coefficient 1 where a hook is offered these numbers."""
    return float(_value(term.expression, {name: np.array([value]) for name, value in known.items()}, 1)[0])


def cell_force(term: ForceTerm, course: Course, edges: Edges, motion: Trajectory) -> CellForce:
    """A term with the coefficient 1 along a motion."""
    cells = len(course.time)
    if term.hook == "structure_force":
        x, v = motion.at(course.time)
        return CellForce(_value(term.expression, {"displacement": x, "velocity": v}, cells))
    value = _value(term.expression, dict(edges.variables), len(edges.cell))
    nothing = np.zeros(len(edges.cell))
    if term.hook == "tangential_force":
        return edges.force(value, nothing, cells)
    return edges.force(nothing, value, cells)
