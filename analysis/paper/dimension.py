"""The choice of the dimension: rank growth, singular values, and why two usual estimates answer another question."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from testbed.analysis.linear.delayed_mathieu import Mathieu, mathieu_recording, simulate_mathieu
from testbed.analysis.multipliers.embedding_dimension import (
    SingularValues,
    false_nearest_neighbours,
    first_minimum,
    mutual_information,
    rank_growth,
    singular_values,
)
from testbed.analysis.paper.bench import IDENTIFIED, NOISE, PASSES, RATE, Bench, clean_record, course_of, cut_at, measured
from testbed.analysis.paper.part import Part, Picture, Statement, Table
from testbed.analysis.paper.style import BLUE, GREEN, GREY, ORANGE, PAGE, RED, figure, letter
from testbed.recording import Recording

SPEED, DEPTH = 2850.0, 2.9  # rpm, mm: the test of figure 5
PERIODS = 20
LEVELS = (0.0, 0.5e-6, 5e-6)  # m
DIMENSIONS = tuple(range(1, 9))
FEW = 0.05  # of neighbours false: the usual reading of "none"


def part_of(recording: Recording, first: int, periods: int) -> Recording:
    """Some delay periods alone, `first` periods after the entry."""
    tau = 2.0 * math.pi / float(recording.conditions["spindle_speed"])
    begin = float(recording.conditions["entry_time"]) + first * tau
    inside = (recording.time >= begin) & (recording.time < begin + periods * tau)
    return Recording({"displacement": recording.channels["displacement"][inside]}, recording.sampling_rate,
                     {"displacement": "m"}, recording.origin, float(recording.time[inside][0]), recording.marks,
                     conditions={"spindle_speed": recording.conditions["spindle_speed"]})


def _milling(clean: Recording, bench: Bench) -> dict[str, Any]:
    """The estimates for each noise level."""
    found: dict[str, Any] = {"singular": {}, "strobed": {}, "information": {}}
    lags = np.arange(1, int(RATE * 60 / SPEED))
    for level in LEVELS:
        record = measured(clean, bench.random("dimension", level), level) if level else clean
        found["singular"][level] = {delays: singular_values(record, delays, periods=PERIODS, noise=level)
                                    for delays in (4, 8, 32)}
        part = part_of(record, 0, PERIODS)
        if level == NOISE:
            later = part_of(record, PASSES - PERIODS, PERIODS)
            found["entry"], found["steady"] = (false_nearest_neighbours(one, DIMENSIONS, lag=lags.size // 8)
                                               for one in (part, later))
        found["strobed"][level] = false_nearest_neighbours(record, DIMENSIONS, stroboscopic=True)
        found["information"][level] = mutual_information(part, lags)
    found["lags"] = lags / RATE * SPEED / 60
    return found


def _draw(ranks: dict[str, np.ndarray], found: dict[str, Any]) -> Any:
    drawn = figure(PAGE, 4.4)
    (growth, levels), (neighbours, information) = drawn.subplots(2, 2)
    for (name, values), marker, colour in zip(ranks.items(), "os", (BLUE, ORANGE), strict=True):
        growth.plot(np.arange(1, values.size + 1), values, f"{marker}-", color=colour, label=name, mfc="white")
    growth.plot([1, 12], [1, 12], ":", color=GREY, lw=0.7, label="rank = $d$")
    growth.set(xlabel="delays in the state, $d$", ylabel="rank of the states", xticks=range(1, 13))
    growth.legend(loc="upper left")
    letter(growth, "a", "rank growth, no noise")
    colours = dict(zip(LEVELS, (GREEN, BLUE, RED), strict=True))
    for level, sets in found["singular"].items():
        one: SingularValues = sets[32]
        name = f"{level * 1e6:g} µm" if level else "no noise"
        levels.semilogy(np.arange(1, 13), one.values[:12], "o-", color=colours[level], ms=2.6, label=name)
        if level:
            levels.axhline(one.floor, color=colours[level], lw=0.6, ls="--")
    levels.set(xlabel="number", ylabel="singular value / largest", ylim=(1e-8, 2), xticks=range(1, 13))
    levels.legend(loc="lower left")
    letter(levels, "b", f"singular values, $d$ = 32, {PERIODS} periods")
    for level in LEVELS:
        name = f"{level * 1e6:g} µm" if level else "no noise"
        neighbours.plot(DIMENSIONS, 100 * found["strobed"][level], "o-", color=colours[level], ms=2.6,
                        label=f"once a delay, {name}")
        information.plot(found["lags"], found["information"][level], color=colours[level], lw=0.8 if level else 2.0,
                         label=name)
        low = first_minimum(found["information"][level])
        if low is not None:
            information.plot(found["lags"][low], found["information"][level][low], "v", color=colours[level], ms=4)
    for part, line in (("entry", "x--"), ("steady", "+:")):
        neighbours.plot(DIMENSIONS, 100 * found[part], line, color="black", ms=4, lw=0.7,
                        label=f"all samples, {part}, 0.5 µm")
    neighbours.set(xlabel="dimension", ylabel="false neighbours (%)", ylim=(-4, 104), xticks=DIMENSIONS)
    neighbours.legend(loc="upper right")
    letter(neighbours, "c", "false nearest neighbours")
    information.set(xlabel=r"lag / $\tau$", ylabel="mutual information (bit)", xlim=(0, 1), ylim=(0.5, 4.2))
    information.legend(loc="upper right", ncols=3)
    letter(information, "d", "mutual information")
    return drawn


def _dimension(fractions: np.ndarray) -> int:
    """The first dimension with few false neighbours; 0 where there is none."""
    few = np.flatnonzero(fractions < FEW)
    return int(DIMENSIONS[few[0]]) if few.size else 0


def make(bench: Bench) -> Part:
    """The part."""
    motion = mathieu_recording(simulate_mathieu(Mathieu(2.2), PERIODS + 2))
    clean = clean_record(bench.reference, IDENTIFIED, course_of(cut_at(SPEED, DEPTH)))
    ranks = {"Mathieu, δ = 2.2": rank_growth(motion, range(1, 13), periods=PERIODS),
             "milling, 2850 rpm, 2.9 mm": rank_growth(clean, range(1, 13), periods=PERIODS)}
    found, ranks_of = _milling(clean, bench), ranks["milling, 2850 rpm, 2.9 mm"]
    rows = []
    for level, sets in found["singular"].items():
        for delays, one in sets.items():
            shown = ", ".join(f"{value:.1e}" for value in one.values[:6])
            above = str(one.rank) if level else "-"  # without noise there is no floor to count from
            rows.append((f"{level * 1e6:g} µm", str(delays), shown, f"{one.floor:.1e}", above))
    at_half = found["singular"][0.5e-6]
    strobed = found["strobed"]
    dimensions = [_dimension(strobed[level]) for level in LEVELS]
    directions = [int(ranks_of[-1])] + [found["singular"][level][32].rank for level in LEVELS[1:]]
    minimum = {level: first_minimum(found["information"][level]) for level in LEVELS}
    quarter = IDENTIFIED.structure.natural_frequency * 60.0 / SPEED  # natural periods in a delay
    places = ", ".join(f"{found['lags'][low]:.3f}" if low is not None else "none" for low in minimum.values())
    statements = (
        Statement("dimension", "without noise the rank of the states stops growing with d",
                  "levels off", "; ".join(f"{name}: {values[-1]} of 12" for name, values in ranks.items()),
                  all(values[-1] < 12 for values in ranks.values()),
                  "to 1e-6 of the largest singular value: more delays add no direction that is still alive"),
        Statement("dimension", "with noise the singular values level off, and d = 4 is enough on the experiment", "d = 4",
                  f"{at_half[32].rank} directions above the noise at 0.5 µm (d = 32), {at_half[4].rank} of 4 with d = 4",
                  at_half[32].rank <= 4, "enough to span the motion; table 1 shows that it is not the best choice"),
        Statement("dimension", "false nearest neighbours do not give the dimension", "rejected",
                  f"below {100 * FEW:.0f} % false at dimension {dimensions[0]}, {dimensions[1]}, {dimensions[2]} with 0, 0.5, "
                  f"5 µm, where {', '.join(map(str, directions))} directions stand above the noise",
                  dimensions != directions, "the estimate grows with the noise while the directions alive become fewer; the "
                  f"steady part, without any transient, gives {_dimension(found['steady'])}, the entry "
                  f"{_dimension(found['entry'])}"),
        Statement("dimension", "the mutual information's first minimum does not give the dimension", "rejected",
                  f"minima at {places} of the delay with 0, 0.5 and 5 µm", True,
                  f"a quarter of the structure's natural period is {0.25 / quarter:.3f} of the delay: that is what is found, "
                  "whatever the number of modes alive"),
    )
    text = (
        "Rank growth counts the directions in which the states move; the singular values do the same amid noise: those of "
        f"{PERIODS} x d white numbers stay below noise x (sqrt({PERIODS}) + sqrt(d)) (dashed), and what stands above moves.",
        "False nearest neighbours need a motion that returns to its own neighbourhood. The entry transient dies within about "
        "20 states: the nearest neighbour of a state is the next one on its way in, and once the transient is below the noise "
        "every neighbour is noise, false in any dimension. With all samples the periodic motion, a closed curve, is what is "
        "unfolded, not the map about it. Mutual information gives a quarter of the natural period, a property of the "
        "structure; the map needs samples over one whole delay.",
    )
    caption = ("Choice of the dimension. (a) Rank of the states over the number of delays, without noise. (b) Normalised "
               "singular values of the milling test; dashed: what noise alone reaches. (c) False nearest neighbours of the "
               "same test: once a delay, and of all samples of its first and last 20 periods. (d) Average mutual "
               "information; triangles: first minimum.")
    table = Table("Directions that stand above the noise", ("noise", "d", "singular values over the largest", "noise reaches",
                                                           "directions"), tuple(rows))
    numbers = {"ranks": ranks, "false_neighbours": strobed, "directions": {f"{level:g}": {str(d): one.rank for d, one in
               sets.items()} for level, sets in found["singular"].items()}}
    return Part("dimension", "Choice of the dimension", text, (Picture("dimension", caption, _draw(ranks, found)),), (table,),
                statements, numbers)
