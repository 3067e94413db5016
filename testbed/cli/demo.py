"""`testbed demo`: the whole loop, from a simulated machine to a published and a measured one, in under two minutes."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from testbed.api.words import shown
from testbed.cli._answer import Answer, progress
from testbed.cli._options import shared
from testbed.cli._places import output_folder

STEPS = 7
SPAN, DEEPEST = (2500.0, 4500.0), 4.0  # of the chart: rpm, mm


@click.command(short_help="The whole loop on the shipped rig, ending with a page to open.",
               epilog="Example: testbed demo -o demo")
@click.option("-o", "--output", default="demo", show_default=True, metavar="DIR",
              help="Folder for the data, the pictures and the page; an earlier demo's are replaced.")
@shared
def command(output: str, json_file: str | None, seed: int | None, quiet: bool) -> None:
    """The five published experiments, a sweep over speed and depth, identification scored against the known truth, and a
    hammer test; then a workshop's campaign with a hidden effect, drawn by --seed: diagnosed, added, revealed.
    """
    from testbed.cli._demo_loop import workshop_folder
    from testbed.cli._demo_page import Page

    demo = _Demo(Answer(json_file, quiet), output_folder(output), seed, quiet, Page("Virtual machining testbed: demo"))
    workshop_folder(demo.folder)  # somebody else's files are found before the work
    began = time.perf_counter()
    demo.published()
    demo.sweep()
    demo.chart()
    demo.identification()
    demo.hammer()
    demo.rig()
    demo.missing_effect()
    page = demo.page.write(demo.folder / "report.html")
    demo.answer.say()
    demo.answer.say(f"done in {time.perf_counter() - began:.0f} s")
    demo.answer.say(f"data:     {', '.join(str(path) for path in demo.data)}")
    demo.answer.say(f"pictures: {', '.join(str(path) for path in demo.pictures)} (diagrams as SVG too)")
    demo.answer.say(f"open:     {page}")
    demo.answer.finish(demo.result | {"data": demo.data, "pictures": demo.pictures, "report": page,
                                      "seconds": time.perf_counter() - began})


class _Demo:
    """The demo's steps, in order; each says what it does, then what came out, and adds it to page and result."""

    def __init__(self, answer: Answer, folder: Path, seed: int | None, quiet: bool, page: Any) -> None:
        self.answer, self.folder, self.seed, self.quiet, self.page = answer, folder, seed, quiet, page
        self.step = 0
        self.result: dict[str, Any] = {"seed": seed, "engine": "mujoco"}
        self.data: list[Path] = []
        self.pictures: list[Path] = []
        self.tests: list[Any] = []
        self.cuts: list[Any] = []

    def _begin(self, title: str) -> None:
        self.step += 1
        self.answer.say(("" if self.step == 1 else "\n") + f"[{self.step}/{STEPS}] {title}")
        self.page.heading(title)

    def _say(self, text: str) -> None:
        self.answer.say(f"  {text}")
        self.page.text(text[:1].upper() + text[1:])

    def _code(self, text: str) -> None:
        self.answer.say(f"  {text}")
        self.page.code(text)

    def _table(self, titles: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
        self.answer.table(("  " + titles[0], *titles[1:]), [("  " + str(row[0]), *row[1:]) for row in rows])
        self.page.table(titles, rows)

    def _picture(self, figure: Any, name: str, says: str) -> None:
        from testbed.analysis.linear.chart_plot import save

        raster, drawing = save(figure, self.folder / name)
        self.pictures.append(raster)
        self.page.picture(drawing, says)

    def _simulate(self, name: str) -> Path:
        from testbed.cli._demo import data_set

        began = time.perf_counter()
        with progress(name, self.quiet) as show:
            report = data_set(name, self.folder, self.seed, show)
        outcomes = ", ".join(f"{count} {outcome}" for outcome, count in report.outcomes.items())
        self._say(f"{report.runs} cuts simulated by MuJoCo in {time.perf_counter() - began:.0f} s ({outcomes}), "
                  f"stored in {report.output}")
        self.data.append(report.output)
        return report.output

    def published(self) -> None:
        """The five published experiments."""
        from testbed.analysis.linear.published import PUBLISHED
        from testbed.analysis.multipliers.published_plot import plot_samples
        from testbed.cli._demo import observe, plain

        self._begin("Five published experiments: observed, by multipliers, and by simulation with loss of contact")
        path = self._simulate("rig_published")
        self.tests = observe(path, [test.name for test in PUBLISHED], [test.outcome for test in PUBLISHED])
        self._table(("case", "speed", "depth", "published", "largest multiplier", "multipliers say", "samples say",
                     "agree"), [_published_row(test) for test in self.tests])
        agree = sum(test.agrees for test in self.tests)
        self._say(f"{agree} of {len(self.tests)} agree in all three; samples: stable settle to one value, flip "
                  "alternate between two, Neimark-Sacker run round a closed curve")
        self._picture(plot_samples({f"{test.name}: {_name(test.simulated)}": test.samples for test in self.tests}),
                      "published_tests", "once-per-tooth samples of the five tests")
        self.result["published"] = [plain(test) for test in self.tests]

    def sweep(self) -> None:
        """Speeds by depths, each cut judged from its samples and by its multipliers."""
        from testbed.cli._demo import observe, plain

        self._begin("A sweep over spindle speed and depth of cut")
        self.cuts = observe(self._simulate("rig_sweep"))
        decided = [cut for cut in self.cuts if cut.simulated != "undecided"]
        same = sum(cut.agrees for cut in decided)
        self._say(f"stable or not: samples and multipliers agree in {same} of {len(decided)} cuts; "
                  f"{len(self.cuts) - len(decided)} undecided after 120 teeth")
        for cut in self.cuts:
            if not cut.agrees:
                self._say(f"{_point(cut)}: multipliers say {_name(cut.linear)} (|mu| = {abs(cut.multiplier):.3f}), "
                          f"samples {_name(cut.simulated)} ({cut.reason})")
        self.result["sweep"] = [plain(cut) for cut in self.cuts]

    def chart(self) -> None:
        """The stability chart with all tests on it."""
        from testbed.analysis.linear.chart_plot import ChartTest, plot_chart
        from testbed.cli._demo import DEPTH_CELLS, SPEED_CELLS, chart

        self._begin("Stability chart, the simulated cuts laid over it")
        began = time.perf_counter()
        speeds = (SPAN[0] * math.pi / 30.0, SPAN[1] * math.pi / 30.0)
        found = chart(self.data[0], speeds, DEEPEST * 1e-3)
        self._say(f"{SPEED_CELLS} x {DEPTH_CELLS} cells in {time.perf_counter() - began:.1f} s")
        overlay = [ChartTest(cut.spindle_speed, cut.axial_depth_of_cut, cut.simulated, cut.name)
                   for cut in (*self.cuts, *self.tests)]
        drawn = plot_chart(found, overlay, "A to E: the published tests")
        self._picture(drawn, "stability_chart", "stability chart with tests")

    def identification(self) -> None:
        """The paper's identification on three stable cuts, scored."""
        from testbed.analysis.linear.chart_plot import plot_multipliers
        from testbed.cli._demo import identified, score_row

        self._begin("The paper's identification from three stable cuts, scored against the known truth")
        path = self._simulate("rig_identification")
        with progress("identifying", self.quiet) as show:
            found = identified(path, show)
        self._table(("parameter", "truth", "first estimate", "95 % interval", "bias", "rms error"),
                    [score_row(one, found.first.parameters[one.parameter]) for one in found.scores])
        one = found.scores[0]
        self._say(f"{one.count - one.failures} of {one.count} campaigns identified, noise {one.noise * 1e6:g} um, "
                  "started from the paper's guess (930 rad/s, Gamma1 5.0e8) by way of the ring-down")
        pairs = {_rpm(test["spindle_speed"]): (test["measured"], test["model"]) for test in found.first.tests}
        self._picture(plot_multipliers(pairs), "multipliers", "measured and model multipliers")
        self.result["identification"] = {"parameters": found.first.parameters, "tests": found.first.tests,
                                         "scores": found.scores, **found.first.quality}

    def hammer(self) -> None:
        """A hammer test: of a measured tool where the files are there, else of the rig, struck in simulation."""
        from testbed.cli._demo import hammer_test, struck_rig, tap_test_folder

        folder = tap_test_folder()
        self._begin("A hammer test: " + ("the rig, struck in simulation" if folder is None else "a milling tool in its holder"))
        found = struck_rig(self.data[0]) if folder is None else hammer_test(folder)
        self.result["hammer_test"] = found
        self._table(("first mode from", "frequency", "damping ratio", "modal mass", "misfit"),
                    [(name, shown(mode["natural_frequency"], "Hz", 6), f"{mode['damping_ratio']:.5f}",
                      shown(mode["modal_mass"], "kg", 4), "-" if mode["misfit"] is None else f"{mode['misfit']:.1%}")
                     for name, mode in found.items()])
        if folder is None:
            self._say("one blow tells frequency, damping and, since its force is measured, the modal mass; "
                      "testbed tap does it with your own blows, in x and y")
            return
        own, other = found.values()
        off = own["natural_frequency"] - other["natural_frequency"]
        self._say(f"{off:+.2f} Hz and {own['damping_ratio'] / other['damping_ratio'] - 1:+.1%} in damping from the "
                  f"receptance file of the same point; the rest, {own['misfit']:.0%} of the response, belongs to "
                  "neighbouring modes, which one mode and two residual terms do not describe")

    def rig(self) -> None:
        """A picture of the rig, where this computer can draw one."""
        from testbed.cli._demo import draw_rig

        self._begin("The rig")
        path = self.folder / "rig.png"
        problem = draw_rig(path)
        if problem is not None:
            self._say(f"no picture of the rig: {problem}")
            return
        self.pictures.append(path)
        self.page.picture(path, "the flexure under the cutter")
        self._say("flexure, specimen and cutter as compiled by MuJoCo")

    def missing_effect(self) -> None:
        """A hidden effect diagnosed from a workshop's files, added, and revealed; the truth is opened last."""
        from testbed.cli._demo_loop import add_story, make, open_truth, run_loop

        self._begin("Which effect is missing? A workshop's campaign, one effect hidden")
        began = time.perf_counter()
        with progress("cutting the workshop's campaign", self.quiet) as show:
            sealed = make(self.folder, self.seed or 0, show)
        self.data += [sealed.campaign, sealed.model]
        self._say(f"five cuts of {sealed.shortest:.1f} to {sealed.longest:.1f} s by MuJoCo in "
                  f"{time.perf_counter() - began:.0f} s, written as a workshop would: CSV with a tachometer, "
                  "campaign.yaml, and model.yaml as believed")
        self._say(f"the truth is sealed in {sealed.truth}, SHA-256 {sealed.digest}")
        self._code(f"testbed diagnose {sealed.campaign} -m {sealed.model}")
        began = time.perf_counter()
        with self.answer.watch.busy("fitting the believed model to all records") as say:
            loop = run_loop(sealed, say)
        self._say(loop.diagnosis.sentence)
        for number, added in enumerate(loop.additions):
            before = loop.written if number else sealed.model
            self._code(f"testbed add {added.effect} -m {before} -c {sealed.campaign} -o {loop.written}")
            self._table(("record, held out", "error before", "after", "noise floor"),
                        [(one.name, f"{one.error:.4f}", f"{two.error:.4f}", f"{two.noise_floor:.4f}")
                         for one, two in zip(added.records_before, added.records_after, strict=True)])
        error = loop.error
        self._say(f"error on cuts left out of the fit: {error['before']:.4f} before, {error['after']:.4f} after, noise floor "
                  f"{error['noise_floor']:.4f}; diagnosed and added in {time.perf_counter() - began:.0f} s")
        add_story(self.page, loop)
        self.result["outlook"] = self._outlook(sealed, loop)
        self.result["workshop"] = self._reveal(open_truth(sealed, loop), sealed, loop, error)

    def _outlook(self, sealed: Any, loop: Any) -> dict[str, Any] | None:
        """The chance of stability once the effect is added, beside the limit before, and the next cuts; None without."""
        from testbed.analysis.probable.plot import plot_chance
        from testbed.cli._demo_outlook import CELLS, RISK, cuts_table, outlook, said

        self.page.heading("How sure, and what next?")
        with self.answer.watch.busy("drawing machines"):
            found = outlook(sealed, loop)
        if found is None:
            self._say("no effect was added, and no chance is given for a machine that the records do not explain")
            return None
        self._code(f"testbed chart {loop.written} --campaign {sealed.campaign} {CELLS}")
        for line in said(found):
            self._say(line)
        if found.sure.chance is not None:
            drawn = plot_chance(found.sure.chance, None, found.sure.recommended, RISK, found.before)
            self._picture(drawn, "probable_stability", "the chance of stability, and the limit before the effect was added")
            self._code(f"testbed plan {sealed.campaign} -m {loop.written} {CELLS} --vibration 0.5mm")
            self._table(*cuts_table(found))
        return found.as_json()

    def _reveal(self, revealed: Any, sealed: Any, loop: Any, error: dict[str, float]) -> dict[str, Any]:
        """Say what the sealed file holds; returns the step's part of the JSON."""
        from testbed.analysis.search.add_effect import as_json
        from testbed.catalogue import catalogue, titled

        self.page.heading("What was hidden?")
        self._say(f"the seal of {sealed.truth} is whole; hidden was {titled([revealed.truth['effect']], catalogue())}: "
                  + ("named right" if revealed.named_right else f"the verdict was {loop.diagnosis.verdict}"))
        self._table(("parameter", "believed", "found", "95 % interval", "truth"), [_truth_row(row) for row in revealed.rows])
        return {"campaign": sealed.campaign, "model": sealed.model, "written": loop.written, "truth_file": sealed.truth,
                "sha256": sealed.digest, "diagnosis": loop.said, "additions": [as_json(one) for one in loop.additions],
                "error": error, "truth": revealed.truth, "named_right": revealed.named_right, "parameters": revealed.rows}


def _truth_row(row: Any) -> tuple[str, ...]:
    known = row["low"] is not None
    digits = 7 if known and row["high"] - row["low"] < 1e-3 * abs(row["value"]) else 5  # so that the ends differ

    def of(key: str) -> str:
        return "-" if row[key] is None else shown(row[key], row["unit"], digits)

    return (row["parameter"], of("believed"), of("value"), f"{of('low')} to {of('high')}" if known else "-", of("truth"))


def _name(verdict: str) -> str:
    from testbed.analysis.linear.stability import said_class

    return said_class(verdict)


def _rpm(speed: float) -> str:
    return f"{speed * 30.0 / math.pi:.0f} rpm"


def _point(cut: Any) -> str:
    return f"{_rpm(cut.spindle_speed)}, {cut.axial_depth_of_cut * 1e3:.2f} mm"


def _published_row(test: Any) -> tuple[str, ...]:
    value = test.multiplier
    shown_value = f"{value.real:+.3f}" if abs(value.imag) < 1e-9 else f"{value.real:+.3f} +- {abs(value.imag):.3f}i"
    return (test.name, _rpm(test.spindle_speed), f"{test.axial_depth_of_cut * 1e3:.1f} mm", _name(test.published),
            shown_value, _name(test.linear), _name(test.simulated), "yes" if test.agrees else "no")
