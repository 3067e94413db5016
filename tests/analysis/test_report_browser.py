"""The pages in a real browser: they open without an error or a request, fit a phone, and answer to their controls."""

import html
import json
import re
import shutil
import subprocess

import pytest

from tests.support import report_pages as pages

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
BROWSER = next((path for path in map(shutil.which, NAMES) if path), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason=f"no headless browser is installed (looked for {', '.join(NAMES)})")
OWN_HOSTS = ("google.com", "googleapis.com", "gvt1.com")  # what the browser itself asks for, page or no page

# what a page reports about itself once it has drawn, to itself and to a frame around it
REPORT = """<script>
(function wait() {
  const root = document.documentElement;
  if (!root.dataset.ready) return setTimeout(wait, 20);
  %s
  const report = {errors: root.dataset.errors || "", wide: root.scrollWidth, room: root.clientWidth,
    requests: performance.getEntriesByType("resource").length,
    drawn: [...document.querySelectorAll("[data-picture]")].filter((one) => one.querySelector("svg.main-svg")).length,
    widest: Math.max(...[...document.querySelectorAll("svg.main-svg")].map((one) => one.getBoundingClientRect().width)),
    found: window.found};
  root.dataset.report = JSON.stringify(report);
  window.parent.postMessage(report, "*");
})();
</script>"""


def opened(path, log=None):
    """The document of a page after its scripts ran."""
    command = [BROWSER, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-dev-shm-usage",
               "--disable-background-networking", "--disable-component-update", "--disable-sync",
               "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={path.parent / 'profile'}",
               "--virtual-time-budget=30000", "--dump-dom"]
    if log is not None:
        command.append(f"--log-net-log={log}")
    done = subprocess.run([*command, path.as_uri()], capture_output=True, text=True, timeout=150)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


def reported(document):
    return json.loads(html.unescape(re.search(r'data-report="([^"]*)"', document).group(1)))


def with_script(page, script=""):
    return page.html().replace("</body>", REPORT % script + "</body>")


def asked_for(log):
    """Addresses on the network that were asked for."""
    text = log.read_text()
    try:
        events = json.loads(text)["events"]
    except json.JSONDecodeError:  # the browser was gone before it closed the list
        events = json.loads(text.rstrip().rstrip(",") + "]}")["events"]
    urls = {(event.get("params") or {}).get("url", "") for event in events}
    hosts = {match.group(1) for url in urls if (match := re.match(r"(?:https?|wss?|ftp)://([^/:]+)", url))}
    return {host for host in hosts if not host.endswith(OWN_HOSTS)}


def test_compare_s_page_opens_without_an_error_or_a_request(tmp_path):
    page = pages.failing_page()
    path = tmp_path / "report.html"
    path.write_text(with_script(page), encoding="utf-8")
    found = reported(opened(path, tmp_path / "net.json"))
    assert found["errors"] == ""
    assert found["requests"] == 0 and asked_for(tmp_path / "net.json") == set()
    assert found["drawn"] == len(page.pictures) >= 6


def test_a_request_and_an_error_would_be_seen(tmp_path):
    text = with_script(pages.failing_page())
    bad = text.replace("<h1>", '<img src="http://elsewhere.invalid/x.png"><h1>', 1).replace('"row":0', '"row":99999', 1)
    path = tmp_path / "bad.html"
    path.write_text(bad, encoding="utf-8")
    found = reported(opened(path))
    assert "elsewhere.invalid" in found["errors"] and "TypeError" in found["errors"]
    free = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", bad)
    path.write_text(free, encoding="utf-8")
    opened(path, tmp_path / "net.json")
    assert asked_for(tmp_path / "net.json") == {"elsewhere.invalid"}


def test_the_pages_fit_a_phone(tmp_path):
    frames = ""
    for name in ("failing_page", "story", "sealed"):
        (tmp_path / f"{name}.html").write_text(with_script(getattr(pages, name)()), encoding="utf-8")
        frames += f'<iframe src="{name}.html" width="390" height="800" style="border:0"></iframe>'
    outer = tmp_path / "phones.html"
    outer.write_text(f"<!doctype html><body>{frames}<script>const all = []; addEventListener('message', (event) => {{"
                     "all.push(event.data); document.documentElement.dataset.report = JSON.stringify(all);});</script></body>")
    found = reported(opened(outer))
    assert len(found) == 3
    for one in found:
        assert one["wide"] <= one["room"] <= 390  # nothing sticks out sideways
        assert 250 < one["widest"] <= 390 and one["errors"] == ""


def test_ticking_an_effect_changes_the_error_shown(tmp_path):
    script = """
  const holder = [...document.querySelectorAll("[data-picture]")].find((one) => one.querySelector("input"));
  const said = () => holder.querySelector("[data-says]").textContent;
  const boxes = [...holder.querySelectorAll("input")], drawn = () => holder.querySelector(".plot").data.length;
  window.found = {first: said(), traces: [drawn()]};
  boxes.find((box) => box.checked).click();
  window.found.none = said(); window.found.traces.push(drawn());
  boxes.forEach((box) => box.click());
  window.found.both = said();
  const select = holder.querySelector("select");
  boxes[1].click(); select.value = "1"; select.dispatchEvent(new Event("change"));
  window.found.other = said();"""
    path = tmp_path / "story.html"
    path.write_text(with_script(pages.story(), script), encoding="utf-8")
    report = reported(opened(path, tmp_path / "net.json"))
    assert report["errors"] == "" and report["requests"] == 0 and asked_for(tmp_path / "net.json") == set()
    assert report["drawn"] == len(pages.story().pictures)
    found = report["found"]
    errors = {name: re.search(r"error ([\d.]+)", found[name]) for name in ("first", "none", "other")}
    story, shown = pages.diagnosis(), re.search(r" on ([^,]+), noise floor", found["first"]).group(1)
    (worst,) = (place for place, one in enumerate(story.base.errors) if one.name == shown)
    assert found["first"].startswith("With process_damping") and found["none"].startswith("With no effect")
    assert float(errors["none"].group(1)) == pytest.approx(story.base.errors[worst].error, abs=1e-4)
    assert float(errors["first"].group(1)) == pytest.approx(story.best.errors[worst].error, abs=1e-4)
    assert found["traces"] == [4, 3]  # the residual without the effect is drawn beside it only when one is ticked
    assert found["both"].startswith("This set was not fitted")
    assert found["other"].startswith("With process_damping") and found["other"] != found["first"]
