"""Every figure and table of Mann and Young (2006), reproduced: the project's targets, and each published statement."""

from __future__ import annotations

import tempfile
from importlib import import_module
from pathlib import Path

from testbed.analysis.paper import PARTS
from testbed.analysis.paper.bench import Bench
from testbed.analysis.paper.part import Part
from testbed.analysis.paper.style import journal
from testbed.engines import fast, mujoco_engine
from tests.validation.claims import Claim, Section

SEED = 2006


def parts(quick: bool = False) -> list[Part]:
    """Every part as `testbed paper` makes it, but for the rendered rig."""
    with tempfile.TemporaryDirectory() as folder, journal():
        bench = Bench(mujoco_engine.simulate, fast.simulate, Path(folder), SEED, quick)
        return [import_module(f"testbed.analysis.paper.{name}").make(bench) for name in PARTS]


def check() -> Section:
    """The section of the table."""
    statements = [one for part in parts() for one in part.statements]
    claims = [Claim(f"{one.place}: {one.claim}", one.published, one.found, one.agrees, one.why)
              for one in statements if one.source == "target"]
    published = [one for one in statements if one.source != "target" and one.agrees is not None]
    differ = [one for one in published if not one.agrees]
    claims.append(Claim("published statements that agree; for the others there is a reason", "all",
                        f"{len(published) - len(differ)} of {len(published)}", all(one.why for one in differ),
                        "; ".join(f"{one.place}: {one.claim}" for one in differ)))
    words = {True: "yes", False: "no", None: "-"}
    rows = tuple((one.place, one.claim, one.published, one.found, words[one.agrees], one.why) for one in statements
                 if one.source != "target")
    return Section("Mann and Young (2006), reproduced", tuple(claims),
                   (("Published and found", ("place", "claim", "published", "found", "agrees", "why"), rows),))
