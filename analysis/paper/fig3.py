"""Fig. 3: a whole cut, its regions found from the signal alone; an exit through a ramp and an abrupt one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from testbed.analysis.paper.bench import IDENTIFIED, IDLE, IMMERSION, Bench, clean_record, course_of, cut_at, measured
from testbed.analysis.paper.part import Part, Picture, Statement, Table
from testbed.analysis.paper.style import PAGE, RED, figure, letter
from testbed.analysis.records.inspection_plot import SEGMENT_COLOURS, envelope
from testbed.analysis.records.segments import Segment, find_segments
from testbed.recording import Recording

SPEED, DEPTH = 3810.0, 2.9
RAMP, RAMP_BEGINS = 0.15, 54  # of the geometric length, which is 80 revolutions; revolutions after the entry
PASSES, RING_DOWN = 70, 50
SHIPPED = Path(__file__).parent / "effects_of_fig3"
REGIONS = {"idle": "idling", "entry": "entry transient", "steady": "steady", "exit": "exit", "ring-down": "post-cut"}


def _records(bench: Bench) -> dict[str, Recording]:
    cut = course_of(cut_at(SPEED, DEPTH), PASSES, RING_DOWN)
    records = {"abrupt stop": clean_record(bench.reference, IDENTIFIED, cut)}
    if not bench.quick:  # the ramp is an effect of this folder: it is compiled when it is first used
        from testbed.catalogue import catalogue

        effects = {"exit_ramp": catalogue(str(SHIPPED))["exit_ramp"]}
        model = IDENTIFIED.with_effect("exit_ramp", extent=RAMP, begin=RAMP_BEGINS * cut.feed_per_tooth)
        records = {"exit over a ramp": clean_record(bench.fast, model, cut, catalogue=effects), **records}
    return records


def _truth(name: str) -> dict[str, float]:
    """Revolutions from the record's start at which things happen."""
    if name == "abrupt stop":  # the last tooth has left by then
        return {"entry": IDLE, "stop": IDLE + PASSES - 1 + IMMERSION}
    return {"entry": IDLE, "exit begins": IDLE + RAMP_BEGINS, "stop": IDLE + RAMP_BEGINS + RAMP * _geometric()}


def _geometric() -> float:
    """Revolutions of a whole geometric ramp: R sin_m over the feed."""
    cutting, cutter = IDENTIFIED.cutting, IDENTIFIED.cutter
    assert cutting is not None and cutter is not None
    return 0.5 * cutter.diameter * float(np.sin(cutting.engagement_angle)) / cut_at(SPEED, DEPTH).feed_per_tooth


def left_ringing(recording: Recording, after: float) -> float:
    """Largest displacement (m) about its later mean within half a revolution after a time (s)."""
    tau = 60.0 / SPEED
    inside = (recording.time >= after) & (recording.time < after + 0.5 * tau)
    rest = recording.channels["displacement"][recording.time > recording.time[-1] - 5 * tau].mean()
    return float(np.abs(recording.channels["displacement"][inside] - rest).max())


def _draw(records: dict[str, Recording], segments: dict[str, tuple[Segment, ...]]) -> Any:
    drawn = figure(PAGE, 1.7 * len(records) + 0.5)
    panels = drawn.subplots(len(records), 1, squeeze=False, sharex=True)[:, 0]
    tau = 60.0 / SPEED
    for axes, panel, (name, record) in zip(panels, "ab", records.items(), strict=False):
        time, signal = envelope(record.time, record.channels["displacement"] * 1e6, 3000)
        axes.plot(time / tau, signal, color="0.2", lw=0.4)
        top = 1.05 * float(np.abs(signal).max())
        for part in segments[name]:
            axes.axvspan(part.start / tau, part.stop / tau, color=SEGMENT_COLOURS[part.kind], alpha=0.7, lw=0)
            axes.text(0.5 * (part.start + part.stop) / tau, 1.25 * top, REGIONS[part.kind], ha="center", va="center",
                      fontsize=7)
        for when in _truth(name).values():
            axes.axvline(when, color=RED, lw=0.7, ls="--")
        axes.set(ylim=(-1.1 * top, 1.45 * top), ylabel="displacement (µm)", xlim=(0, record.time[-1] / tau))
        letter(axes, panel, name)
    panels[-1].set_xlabel("spindle revolutions")
    return drawn


def make(bench: Bench) -> Part:
    """The part."""
    clean = _records(bench)
    records = {name: measured(record, bench.random("fig3", name)) for name, record in clean.items()}
    segments = {name: find_segments(record) for name, record in records.items()}
    tau, rows, worst = 60.0 / SPEED, [], 0.0
    for name, parts in segments.items():
        for part in parts:
            rows.append((name, REGIONS[part.kind], f"{part.start / tau:.2f}", f"{part.stop / tau:.2f}"))
        begin = min(part.start for part in parts if part.kind == "entry") / tau
        end = min(part.start for part in parts if part.start / tau > 20 and part.kind in ("ring-down", "idle")) / tau
        truth = _truth(name)
        worst = max(worst, abs(begin - truth["entry"]), abs(end - truth["stop"]) if name == "abrupt stop" else 0.0)
    kinds = {part.kind for parts in segments.values() for part in parts}
    left = {name: left_ringing(record, _truth(name)["stop"] * tau) for name, record in clean.items()}
    statements = [
        Statement("fig. 3", "a cut shows entry transient, steady cutting, exit and post-cut ring-down", "four regions",
                  ", ".join(REGIONS[kind] for kind in REGIONS if kind in kinds),
                  kinds >= ({"entry", "steady", "ring-down"} if bench.quick else {"entry", "steady", "exit", "ring-down"}),
                  "found from the signal alone, no time fixed in advance"),
        Statement("fig. 3", "entry and abrupt stop found from the signal", "(no number)",
                  f"off by at most {worst:.3f} revolutions", worst < 0.05, "", "target"),
        Statement("fig. 3", "an abrupt stop leaves a ring-down", "18-140 µm", f"{left['abrupt stop'] * 1e6:.0f} µm",
                  18e-6 <= left["abrupt stop"] <= 140e-6, "the range is over tests", "inferred"),
        Statement("fig. 3", "a geometric ramp of entry or exit lasts R sin(2 pi rho) / h", "80 revolutions",
                  f"{_geometric():.1f} revolutions", abs(_geometric() - 80) < 1.0,
                  "whether the experiment had it is unknown: a step is assumed", "unknown")]
    if not bench.quick:
        still = left["exit over a ramp"]
        statements.append(Statement("fig. 3", "a geometric exit leaves no ring-down worth identifying from", "< 0.5 µm",
                                    f"{still * 1e6:.2f} µm", still < 0.5e-6,
                                    f"over {RAMP:.0%} of the geometric ramp already; without the sensor's noise",
                                    "inferred"))
    text = ("How the tool entered and left the work is not known: here the entry is a step to full engagement, and the exit "
            f"either an abrupt stop or a ramp over {RAMP * _geometric():.0f} revolutions ({RAMP:.0%} of the geometric one). "
            "The paper takes damping and frequency from the post-cut ring-down; only the abrupt stop leaves one.",)
    caption = (f"A whole cut at {SPEED:.0f} rpm, {DEPTH} mm with 0.5 µm noise. Shaded: regions found automatically; dashed: "
               "when the tool in truth entered, began to leave and left.")
    table = Table("Regions found (spindle revolutions)", ("record", "region", "from", "to"), tuple(rows))
    return Part("fig3", "Figure 3: a whole cut and its regions", text, (Picture("fig3", caption, _draw(records, segments)),),
                (table,), tuple(statements), {"ring_down_amplitude": left, "worst_revolutions": worst})
