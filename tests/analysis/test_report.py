"""The report's pages: what they carry, that they fetch nothing, and that their sentences follow the data."""

import base64
import json
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy.stats import binomtest, spearmanr

from testbed.analysis.comparison.compare import as_json as comparison_json
from testbed.analysis.comparison.compare_plots import force_state_map
from testbed.analysis.comparison.constancy import TestFit, judged
from testbed.analysis.comparison.residual_views import by_angle, by_frequency
from testbed.analysis.estimate import Estimate
from testbed.analysis.force.force_state import ForceState
from testbed.analysis.report.chart import rank_correlation
from testbed.analysis.report.compare_page import compare_page, verdict_of
from testbed.analysis.report.constants import add_constancy
from testbed.analysis.report.force_map import add_force_map, force_map_says
from testbed.analysis.report.machine import said_change
from testbed.analysis.report.packed import packed, thinned
from testbed.analysis.report.page import Page, Panel, heat_colour
from testbed.analysis.report.story_page import addition_page, diagnosis_page
from testbed.analysis.search.answer import as_json
from testbed.analysis.search.diagnosis import unaided
from testbed.analysis.search.diagnosis import verdict_of as verdict_over
from testbed.analysis.search.false_alarms import FalseAlarms
from testbed.api.best_fit import force_maps
from tests.support import report_pages as pages
from tests.support.campaign_files import BELIEVED, TRUE


def unpacked(row):
    """What the page's script makes of a packed row."""
    if "n" in row:
        return row["from"] + row["step"] * np.arange(row["n"])
    counts = np.frombuffer(base64.b64decode(row["i2"]), "<i2").astype(float)
    values = np.where(counts == -32768, np.nan, row["offset"] + row["scale"] * counts)
    return 10**values if "log" in row else values


def test_packed_rows_come_back():
    values = np.random.default_rng(0).normal(3.0, 2.0, 1000)
    values[[3, 500]] = np.nan, np.inf
    back = unpacked(packed(values))
    known = np.isfinite(values)
    assert np.array_equal(np.isfinite(back), known) and np.allclose(unpacked(packed(np.full(4, 7.5))), 7.5)
    assert np.abs(back - values)[known].max() < 2e-5 * np.ptp(values[known])
    small = np.geomspace(1e-9, 1e3, 50)
    assert np.allclose(unpacked(packed(small, logarithmic=True)), small, rtol=1e-3)


@pytest.mark.parametrize("count", [5000, 5001, 123457])
def test_an_envelope_loses_no_peak(count):
    values = np.random.default_rng(1).normal(size=count)
    values[count // 3], values[count - 1] = 40.0, -50.0
    time, row = thinned(values, 2.0, 1000.0, 400)
    x, y = unpacked(time), unpacked(row)
    assert len(x) == len(y) <= 404
    assert y.max() == pytest.approx(40.0, abs=1e-2) and y.min() == pytest.approx(-50.0, abs=1e-2)
    assert x[np.argmax(y)] == pytest.approx(2.0 + count // 3 / 1000.0, abs=2 * count / 400 / 1000.0)
    assert x[0] >= 2.0 and x[-1] <= 2.0 + count / 1000.0 + 0.5


class Outside(HTMLParser):
    """Collects whatever a page's markup would fetch or leave open."""

    def __init__(self):
        super().__init__()
        self.fetched, self.headings = [], []
        self._in_heading = False

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name in ("src", "href", "srcset", "action", "data") and not value.startswith(("#", "data:")):
                self.fetched.append((tag, value))
        self._in_heading = tag == "h2"

    def handle_data(self, data):
        if self._in_heading:
            self.headings.append(data)
            self._in_heading = False


@pytest.mark.parametrize("made", [pages.failing_page, pages.story, pages.added])
def test_a_page_is_one_small_file_that_fetches_nothing(made):
    text = made().html()
    assert len(text.encode()) < 6e6
    assert text.count("* plotly.js v") == 1  # the library's own head, once
    reader = Outside()
    reader.feed(text)
    assert reader.fetched == [] and "default-src 'none'" in text
    assert len(reader.headings) >= 4 and all("?" in heading for heading in reader.headings)
    assert text.count('class="answer"') >= len(reader.headings) - 1  # the boxes to tick answer by themselves


def test_rows_that_pictures_share_are_carried_once():
    values = np.random.default_rng(2).normal(size=300)
    page = Page("two")
    for _ in range(2):
        page.figure(Panel([{"type": "scatter", "y": packed(values)}]))
    data = json.loads(re.search(r'id="pictures">(.*?)</script>', page.html(), re.DOTALL).group(1))
    assert len(data["rows"]) == 1
    assert [picture["panels"][""]["traces"][0]["y"]["row"] for picture in data["pictures"]] == [0, 0]


def test_intervals_of_constants_are_drawn_as_they_are():
    frequency = Estimate(100.0, 99.0, 101.5, "Hz")
    found = {"tangential_coefficient": Estimate(1e6, 0.0, 7e7, "N/m^2"), "natural_frequency": frequency}
    tests = [TestFit(f"cut {number}", {}, found, True) for number in range(2)]
    page = Page("constants")
    add_constancy(page, judged(tests), {})
    bars = page.pictures[0]["panels"]["1|0"]["traces"][0]["error_y"]
    assert bars["array"] == [69.0, 69.0] and bars["arrayminus"] == [1.0, 1.0] and bars["symmetric"] is False  # N/mm^2
    assert "f_n [Hz]" in page.html()


def stuck_at_its_bound():
    """A comparison of which the tangential coefficient ended where the range searched ends."""
    found, path = pages.comparison(), "tangential_coefficient"
    low = next(one.bounds[0] for one in found.fitter.free if one.path == path)
    return replace(found, parameters={**found.parameters, path: replace(found.parameters[path], value=low, low=low)})


def test_a_parameter_at_its_bound_is_told_on_the_page_and_in_the_json():
    found = stuck_at_its_bound()
    assert found.at_bound == ("tangential_coefficient",) and pages.comparison().at_bound == ()
    assert comparison_json(found)["at_bound"] == ["tangential_coefficient"]
    assert comparison_json(pages.comparison())["at_bound"] == []
    text = compare_page(found, BELIEVED, pages.CATALOGUE, pages.UNITS).html()
    assert text.count("tangential_coefficient at the end of the range searched") == 2 and "(at a bound)" in text
    assert "tangential_coefficient moved most, by -99.9%." in text  # a fall to a thousandth is more than any rise
    assert "The fit settled, with tangential_coefficient" in text and "The fit settled.<" not in text
    assert "at a bound" not in pages.failing_page().html() and "The fit settled.<" in pages.failing_page().html()


def test_a_parameter_of_an_effect_added_is_told_at_its_bound():
    text = addition_page(replace(pages.addition(), at_bound=("damping_ratio",)), pages.records(), BELIEVED, pages.UNITS).html()
    assert "The fit settled, with damping_ratio at the end of the range searched" in text and "(at a bound)" in text


@pytest.mark.parametrize(("change", "said"), [
    (0.25, "+25.0%"), (-0.999, "-99.9%"), (9.9, "+990.0%"), (20.0, "more than ten times"),
    (900.668, "more than a hundred times"), (math.nan, "-")])
def test_a_change_beyond_percentages_is_told_in_words(change, said):
    assert said_change(change) == said


def test_the_step_before_anything_is_added_is_the_model_refitted():
    assert unaided(BELIEVED) == "refitted, no effect" and unaided(pages.HIDDEN) == "refitted, with process_damping"
    for page in (pages.story(), pages.added()):
        bars = page.pictures[0]["panels"][""]["traces"][0]
        assert [name.split("<br>")[0] for name in bars["x"]] == ["refitted, no effect", f"+ {pages.EFFECT}"]
        assert [name.split("<br>")[1] for name in bars["x"]] == [f"{error:.4f}" for error in bars["y"]]


def test_axes_name_what_they_show_and_candidates_have_units():
    axes = [panel["layout"] for page in (pages.failing_page(), pages.story()) for picture in page.pictures
            for panel in picture["panels"].values() if panel["layout"].get("yaxis2", {}).get("title")]
    assert len(axes) > 6
    assert {one["yaxis"]["title"]["text"] for one in axes} == {"displacement [µm]"}
    assert {one["yaxis2"]["title"]["text"] for one in axes} == {"residual [µm]"}
    assert re.search(r"process_damping\.coefficient = [\d.e+]+ N/m<", pages.story().html())


def test_no_line_crosses_the_number_of_a_bar():
    bars = next(picture["panels"][""] for picture in pages.story().pictures
                if picture["panels"].get("", {}).get("layout", {}).get("annotations"))
    numbers = bars["layout"]["annotations"]
    assert [one["text"] for one in numbers] == [f"{value:.4f}" for value in bars["traces"][0]["x"]]
    assert [one["y"] for one in numbers] == bars["traces"][0]["y"]
    assert all(one["xref"] == "paper" and one["x"] == 1.0 and one["xanchor"] == "left" for one in numbers)
    assert "text" not in bars["traces"][0]


def test_what_users_wrote_is_escaped():
    page = Page("<script>alert(1)</script>")
    page.heading("<b>?")
    page.table(("<i>",), [("</td><script>",)])
    page.figure(Panel([{"name": "</script><script>alert(2)</script>", "y": [1.0]}]))
    text = page.html()
    assert "<script>alert" not in text and "</script><script>alert" not in text and "<b>?" not in text


def test_a_page_without_pictures_carries_no_library():
    page = Page("plain")
    page.text("nothing to draw")
    assert len(page.html()) < 10_000 and "<script" not in page.html()


def test_the_sentences_follow_the_data():
    failing, complete = pages.comparison(), pages.comparison(TRUE)
    assert not failing.adequate and complete.adequate
    assert "more than noise" in verdict_of(failing) and "down to its noise" in verdict_of(complete)
    worst = max(failing.records, key=lambda one: one.chi_square).name
    assert worst in verdict_of(failing)
    text = compare_page(complete, BELIEVED, pages.CATALOGUE, pages.UNITS).html()
    for said in ("0 of 3 records hold more than noise", "At none in particular", "Nowhere: all 3 cuts"):
        assert said in text
    assert "0 of 3 records hold more than noise" not in pages.failing_page().html()


def test_of_noise_alone_the_page_calls_no_model_good_or_bad():
    complete = pages.comparison(TRUE)
    silent = replace(complete, records=tuple(replace(one, noise_floor=1.0) for one in complete.records))
    assert silent.adequate and silent.says_nothing and "does not test the model" in verdict_of(silent)
    page = compare_page(silent, BELIEVED, pages.CATALOGUE, pages.UNITS).html()
    assert 'class="verdict"' in page and 'class="verdict good"' not in page


def test_the_story_says_what_was_found():
    text = pages.story().html()
    found = pages.diagnosis()
    assert f"From {found.baseline:.4f} to {found.with_effects:.4f} in 1 step" in text
    assert "3037 rpm and 1.8 mm" in text  # the next test
    assert found.with_effects < 0.9 * found.baseline
    assert "process_damping.coefficient" in text and "one warning" in pages.added().html()


def test_the_story_of_one_condition_calls_nothing_held_out():
    found, said = pages.diagnosis(), {"next_test": None}
    steps, base = list(found.steps), replace(found.base, fitter=SimpleNamespace(records=pages.records()[:1]))
    one = verdict_over(base, found.best, steps, found.candidates, found.noise_floor, ())
    both = verdict_over(found.base, found.best, steps, found.candidates, found.noise_floor, ())
    assert both.held_out and not one.held_out and one.verdict == both.verdict == "missing_effect"
    assert "the error on records left out of the fit falls from" in both.sentence
    assert "the error in the fit (one condition only, nothing held out) falls from" in one.sentence
    assert as_json(both, BELIEVED)["held_out"] is True and as_json(one, BELIEVED)["held_out"] is False
    words = ("predicts records it never saw", "left out of the fit", "error, held out", "error held out")
    texts = [diagnosis_page(told, said, BELIEVED, pages.CATALOGUE, pages.UNITS).html() for told in (both, one)]
    for word in words:
        assert word in texts[0] and word not in texts[1], word
    assert "Nothing was held out" in texts[1] and "Nothing was held out" not in texts[0]


def before_and_after(page):
    """Rows y of the residual before and after over the tooth's angle, of the record shown first."""
    spec = next(one for one in page.pictures if "0|1" in one["panels"])
    return [unpacked(trace["y"]) for trace in spec["panels"]["0|1"]["traces"]]


def test_each_residual_is_seen_by_the_tooth_angle_of_its_own_fit():
    found, shift = pages.addition(), np.deg2rad(90.0)
    turned = replace(found.bare.state, angle=found.bare.state.angle + shift)
    other = replace(found, bare=replace(found.bare, state=turned))
    looks = [before_and_after(addition_page(one, pages.records(), BELIEVED, pages.UNITS)) for one in (found, other)]
    worst = max(range(3), key=lambda one: found.records_before[one].squares / found.records_before[one].noise_squares)
    for state, (before, after) in zip((found.bare.state, turned), looks, strict=True):
        for row, error, own in ((before, found.records_before, state), (after, found.records_after, found.fit.state)):
            expected = by_angle(pages.records()[worst], error[worst], own, worst)[0].mean
            assert np.allclose(row, expected, atol=1e-4 * np.ptp(expected))
    assert np.abs(looks[0][0] - looks[1][0]).max() > 0.5 * np.ptp(looks[0][0])  # a quarter of a turn further
    assert np.array_equal(looks[0][1], looks[1][1])


def test_every_fitted_set_can_be_ticked():
    spec = next(one for one in pages.story().pictures if "missing" in one)
    assert {key.split("|")[0] for key in spec["panels"]} == {"", pages.EFFECT, pages.OTHER}
    assert len(spec["panels"]) == 3 * len(pages.records())
    bare, own = (spec["panels"][f"{name}|0"]["says"] for name in ("", pages.EFFECT))
    error = [float(re.search(r"error ([\d.]+)", text).group(1)) for text in (bare, own)]
    assert error[1] < 0.8 * error[0]


def test_the_angle_and_the_line_are_found_where_they_were_put():
    found = pages.comparison(TRUE)
    record, error, state = found.fitter.records[0], found.errors[0], found.fit.state
    time = record.start + np.arange(record.samples) / record.rate
    turning = 1.0 / record.period

    def left(values):
        return type(error)(error.name, 1.0, error.noise_floor, values[None], 1.0, 1.0, 1.0)

    view = by_frequency(record, left(1e-4 * np.sin(2 * np.pi * 3 * turning * time)), state, 0)[0]
    assert view.shares["tooth passing"] > 0.99
    assert view.frequency[np.argmax(view.amplitude)] == pytest.approx(3 * turning, rel=1e-3)
    between = left(1e-4 * np.sin(2 * np.pi * 2.5 * turning * time))
    assert by_frequency(record, between, state, 0)[0].shares["tooth passing"] < 0.05
    entry = record.pass_start(20, state.angle, state.nuisances[0])
    bump = np.zeros(record.samples)
    for turn in range(40):  # a blow 30 degrees after every entry
        bump[round((entry + (turn + 30 / 360) * record.period - record.start) * record.rate)] = 1e-3
    assert by_angle(record, left(bump), state, 0)[0].peak[0] == pytest.approx(30.0, abs=5.0)


def test_the_force_map_says_what_the_force_goes_with():
    random = np.random.default_rng(3)
    x, v = random.normal(size=(2, 5000)) * [[1e-4], [0.1]]
    assert "goes with displacement" in force_map_says(x, v, 1e12 * x**3 + 0.1 * random.normal(size=5000))
    assert "goes with velocity" in force_map_says(x, v, 50.0 * v * np.abs(v))
    assert "goes with neither" in force_map_says(x, v, random.normal(size=5000))
    page = Page("map")
    add_force_map(page, "cut 1", x, v, 50.0 * v)
    assert "velocity" in page.html() and "chip force" not in page.html()
    add_force_map(page, "cut 1, while a tooth cuts", x, v, 50.0 * v)
    assert "it holds the error of the chip force, too" in page.html() and "no tooth cuts there" not in page.html()


def test_maps_in_and_out_of_the_cut_are_drawn_apart():
    random = np.random.default_rng(3)
    maps = [ForceState(f"cut 1, {where}", *random.normal(size=(2, 300)), size * random.normal(size=300))
            for where, size in (("while a tooth cuts", 100.0), ("out of the cut", 1.0))]  # fmt: skip
    figure = Figure()
    force_state_map(figure, maps)
    panels = [axis for axis in figure.axes if axis.get_title()]
    assert [axis.get_title().split("\n")[0] for axis in panels] == ["cut 1, out of the cut", "cut 1, while a tooth cuts"]
    assert "chip force" not in panels[0].get_title() and "chip force" in panels[1].get_title()
    scales = [axis.collections[0].get_clim()[1] for axis in panels]
    assert 1 < scales[0] < 5 and 100 < scales[1] < 500  # the small force is seen beside the large one


def test_diagnose_maps_what_its_best_model_still_lacks():
    found = pages.diagnosis()
    assert force_maps(found, pages.CATALOGUE) == []  # with process damping only noise is left
    lacking = replace(found, best=found.base)
    maps = force_maps(lacking, pages.CATALOGUE)
    worst = max(found.base.errors, key=lambda one: one.error / one.noise_floor)
    assert {name.split(",")[0] for name, *_ in maps} == {worst.name}
    said = {"next_test": None}
    text = diagnosis_page(lacking, said, BELIEVED, pages.CATALOGUE, pages.UNITS, force_maps=maps).html()
    assert text.count("What does the missing force depend on") >= len(maps) > 0


def test_heat_runs_from_green_to_red():
    calm, hot = (tuple(int(heat_colour(value)[k : k + 2], 16) for k in (1, 3, 5)) for value in (-1.0, 2.0))
    assert calm[1] > calm[0] and hot[0] > hot[1]


def test_rank_correlation_is_that_of_scipy():
    random = np.random.default_rng(61)
    for size in (3, 5, 8, 30):
        one, other = random.integers(0, 6, size) + np.arange(size) % 2, random.normal(size=size)
        known = spearmanr(one, other)
        assert rank_correlation(one, other) == pytest.approx((known.statistic, known.pvalue), rel=1e-9)
    assert rank_correlation(np.arange(5.0), np.arange(5.0) ** 3) == pytest.approx((1.0, 0.0), abs=1e-12)


def test_interval_of_a_rate_is_the_exact_one():
    for count in (1, 7, 40):
        for alarms in range(count + 1):
            known = binomtest(alarms, count).proportion_ci(0.95, method="exact")
            assert FalseAlarms(count, alarms, ()).interval == pytest.approx((known.low, known.high), abs=1e-10)
