"""Fig. 5: the stable cut at 2850 rpm, 2.9 mm: states, singular values, the motion on its torus and the section of it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from testbed.analysis.multipliers.embedding_dimension import singular_values
from testbed.analysis.multipliers.floquet import once_per_period_samples, tooth_period
from testbed.analysis.paper.bench import IDENTIFIED, NOISE, PASSES, Bench, clean_record, course_of, cut_at, measured
from testbed.analysis.paper.part import Part, Picture, Statement
from testbed.analysis.paper.style import BLUE, GREY, ORANGE, PAGE, RED, figure, letter
from testbed.recording import Recording

SPEED, DEPTH = 2850.0, 2.9
STATES, SHOWN, PHASES = 4, 30, 256
RADIUS = 2.2  # of the drawn torus, over the largest displacement


def _fill(axes: Any, name: str, states: np.ndarray) -> None:
    for k, (marker, colour) in enumerate(zip("os^D", (BLUE, RED, ORANGE, "black"), strict=True)):
        axes.plot(states[:SHOWN, k] * 1e6, marker, color=colour, ms=2.8, mfc=colour if k == 0 else "white", mew=0.7,
                  label=rf"$y_n({k + 1})$")
    axes.set(xlabel="revolution $n$", ylabel="displacement (µm)", xlim=(-0.7, SHOWN))
    axes.margins(y=0.22)
    axes.legend(ncols=4, loc="upper right", handletextpad=0.0, columnspacing=0.6)
    letter(axes, name, "states, once a revolution")


def _torus(axes: Any, motion: np.ndarray) -> None:
    """motion (periods, PHASES): angle is t mod tau, the section's plane is x(t) against x(t - tau / 4)."""
    size = float(np.abs(motion).max())
    flat = motion.ravel() / size
    lag = PHASES // 4
    angle = 2.0 * math.pi * (np.arange(flat.size) % PHASES) / PHASES
    here, before = flat[lag:], flat[:-lag]
    x, y = (RADIUS + here) * np.cos(angle[lag:]), (RADIUS + here) * np.sin(angle[lag:])
    axes.plot(x[:-4 * PHASES], y[:-4 * PHASES], before[:-4 * PHASES], color=GREY, lw=0.25, alpha=0.8)
    axes.plot(x[-PHASES:], y[-PHASES:], before[-PHASES:], color=BLUE, lw=1.2)
    at = np.arange(PHASES - lag, here.size, PHASES)
    axes.plot(x[at], y[at], before[at], "o", color=RED, ms=2.2)
    corner = np.array([-1, 1, 1, -1, -1])
    axes.plot(RADIUS + corner, 0 * corner, np.array([-1, -1, 1, 1, -1]), color=RED, lw=0.6)
    reach = RADIUS + 1.0
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    for radius in (RADIUS - 1.0, RADIUS + 1.0):  # where the torus stands
        axes.plot(radius * np.cos(turn), radius * np.sin(turn), 0 * turn, ":", color="0.7", lw=0.6)
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), zlim=(-1.0, 1.0))
    axes.set_box_aspect((reach, reach, 1.0), zoom=1.75)
    axes.view_init(elev=38, azim=-50)
    for line in axes.lines:  # the square of a drawing in space is narrower than its panel
        line.set_clip_on(False)
        line.set_in_layout(False)
    axes.set_axis_off()


def _section(axes: Any, states: np.ndarray) -> None:
    """x(n tau) against x(n tau - tau / 4), the first visits numbered."""
    here, before = states[1:, 0] * 1e6, states[:-1, 3] * 1e6
    axes.plot(here, before, "-", color="0.8", lw=0.5)
    axes.plot(here, before, "o", color=RED, ms=2.6)
    axes.plot(here[-20:].mean(), before[-20:].mean(), "+", color="black", ms=8, mew=1)
    for n in range(5):
        axes.annotate(str(n + 1), (here[n], before[n]), textcoords="offset points", xytext=(4, 3), fontsize=7)
    axes.margins(0.1)
    axes.set(xlabel=r"$x(n\tau)$ (µm)", ylabel=r"$x(n\tau - \tau/4)$ (µm)")
    letter(axes, "d", "its section")


def _draw(record: Recording, states: np.ndarray, motion: np.ndarray, clean: Recording) -> Any:
    drawn = figure(PAGE, 4.6)
    grid = drawn.add_gridspec(2, 2)
    _fill(drawn.add_subplot(grid[0, 0]), "a", states)
    axes = drawn.add_subplot(grid[0, 1])
    for name, source, level, colour, marker in (("0.5 µm noise", record, NOISE, BLUE, "o"),
                                                ("no noise", clean, 0.0, GREY, "s")):
        found = singular_values(source, 12, periods=PASSES - 1, noise=level)
        axes.semilogy(np.arange(1, 13), found.values, f"{marker}-", color=colour, mfc="white", label=name)
        if level:
            axes.axhline(found.floor, color=colour, lw=0.6, ls="--")
    axes.set(xlabel="number", ylabel="singular value / largest", xticks=range(1, 13), ylim=(1e-10, 3))
    axes.legend(loc="lower left")
    letter(axes, "b", "singular values, $d$ = 12")
    torus = drawn.add_subplot(grid[1, 0], projection="3d")
    _torus(torus, motion)
    # the drawing's own axes are narrower than the panel: its title stands where those of the others do
    torus.text2D(-0.33, 1.04, r"(c) the motion over $t$ mod $\tau$", transform=torus.transAxes, in_layout=False)
    _section(drawn.add_subplot(grid[1, 1]), states)
    return drawn


def make(bench: Bench) -> Part:
    """The part."""
    clean = clean_record(bench.reference, IDENTIFIED, course_of(cut_at(SPEED, DEPTH)))
    record = measured(clean, bench.random("fig5"))
    begin, end = (float(record.conditions[name]) for name in ("entry_time", "exit_time"))
    states, motion = (once_per_period_samples(record, tooth_period(record), begin, end, count) for count in (STATES, PHASES))
    found = singular_values(record, 12, periods=PASSES - 1, noise=NOISE)
    last, first = states[-20:], states[:20]
    settled = float(last.std(axis=0).max())
    statements = (
        Statement("fig. 5", "2850 rpm, 2.9 mm: the states settle, the cut is stable", "stable",
                  f"rms of the last 20 states {settled * 1e6:.2f} µm, of the first 20 "
                  f"{first.std(axis=0).max() * 1e6:.1f} µm; noise 0.50 µm", settled < 2 * NOISE),
        Statement("fig. 5", "singular values level off after a few; four states suffice", "d = 4",
                  f"{found.rank} above the noise", found.rank <= 4),
    )
    text = ("The motion is drawn over the angle 2 pi t / tau; a section at one angle is the map whose multipliers are "
            "identified. In steady cutting the motion closes upon itself: a circle on the torus, a point in the section.",)
    caption = (f"The stable cut at {SPEED:.0f} rpm, {DEPTH} mm, 0.5 µm noise. (a) Four states a revolution from the entry. (b) "
               "Normalised singular values of the states of the whole cut; dashed: what noise alone reaches. (c) The motion "
               "over t mod tau; blue: the last revolution; red: the section. (d) That section; numbered: the first five "
               "revolutions; the cross: the fixed point.")
    return Part("fig5", "Figure 5: states, singular values and section of a stable cut", text,
                (Picture("fig5", caption, _draw(record, states, motion, clean)),), (), statements,
                {"settled_rms": settled, "singular_values": found.values, "floor": found.floor, "directions": found.rank})
