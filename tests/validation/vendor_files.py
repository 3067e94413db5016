"""Files as measuring software writes them (tests/support/vendor_files.py), with known contents, read as a campaign reads them.

Right: every channel to 1e-5 of its range, its unit, its rate (to 0.4 % where the printed digits of the times leave it open),
and what must be told is told. Refused: one line that says what to do; some must be. Wrong: anything else.
"""

from __future__ import annotations

import json
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from testbed.files.campaign import load_campaign
from testbed.problem import InputProblem
from tests.support import vendor_files as vendor
from tests.validation.claims import Claim, Section

DRAWS = 3
CLOSE = 1e-5  # of a channel's range


def judge(kind: str, seed: int, folder: Path) -> str:
    """`right`, `refused` or `wrong`, and behind it what was said or is off."""
    made = vendor.KINDS[kind](vendor.Draw(seed, folder))
    campaign = folder / "campaign.yaml"
    record = {"file": made.name, "kind": "excited", "channels": made.channels, **made.more}
    campaign.write_text(json.dumps({"name": kind, "records": [record]}))  # JSON is YAML
    try:
        found = load_campaign(campaign).records[0]
    except InputProblem as problem:
        said = str(problem)
        return f"refused {said}" if "\n" not in said and problem.do else f"wrong (no advice) {said}"
    if made.response is None:
        return "wrong (read, though it must be refused)"
    recording = found.recording
    if abs(recording.sampling_rate / made.rate - 1) > made.rate_error:
        return f"wrong (rate {recording.sampling_rate:.7g} Hz for {made.rate:g})"
    for name, truth in (("force", made.force), (found.responses[0], made.response)):
        if truth is None:
            continue
        values = recording.channels[name]
        if len(values) != len(truth) or np.abs(values - truth).max() > CLOSE * np.ptp(truth):
            return f"wrong ({name})"
    if recording.units[found.responses[0]] != made.unit:
        return f"wrong (in {recording.units[found.responses[0]]})"
    if made.told and not any(made.told in note for note in found.notes):
        return f"wrong (not told: {made.told})"
    return "right"


def outcomes(draws: int = DRAWS) -> dict[str, list[str]]:
    """What every draw of every kind gives."""
    result: dict[str, list[str]] = {}
    for number, kind in enumerate(vendor.KINDS):
        result[kind] = []
        for draw in range(draws):
            with tempfile.TemporaryDirectory() as folder:
                result[kind].append(judge(kind, 1000 * number + draw, Path(folder)))
    return result


def check() -> Section:
    """The section of the table."""
    found = outcomes()
    counted = Counter(outcome.split()[0] for each in found.values() for outcome in each)
    must = {kind for kind, each in found.items() if all(outcome.startswith("refused") for outcome in each)}
    missed = sum(outcome.startswith("refused") for kind, each in found.items() if kind not in must for outcome in each)
    total = sum(counted.values())
    claims = (
        Claim("files read to other numbers, units or rates than they hold, or without what must be told", "0",
              f"{counted['wrong']} of {total}", counted["wrong"] == 0),
        Claim("files read right", "-", f"{counted['right']} of {total}", None,
              f"{len(found)} kinds; {counted['refused']} were refused in one line, {len(must)} kinds always"),
        Claim("refused of kinds that are read at other times", "-", str(missed), None, "times printed with too few digits"),
    )  # fmt: skip
    words = ("right", "refused", "wrong")
    rows = tuple((kind.replace("_", " "), *(str(sum(outcome.startswith(word) for outcome in each)) for word in words))
                 for kind, each in found.items())  # fmt: skip
    return Section(f"Files of measuring software ({total} files of {len(found)} kinds)", claims,
                   (("Kinds", ("kind", *words), rows),))  # fmt: skip
