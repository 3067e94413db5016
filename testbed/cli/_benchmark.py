"""The campaigns of `testbed benchmark`: drawn, cut by the MuJoCo engine, written as a workshop's files, their truth sealed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from testbed.benchmark.answers import PARAMETERS
from testbed.problem import InputProblem

FORMAT = 1
NOTE = "benchmark.json"
KIND = "sealed truth of a testbed benchmark"
NONE_HIDDEN = 0.25  # share of campaigns without a hidden effect
NOISES = (0.3e-6, 3e-6)  # m, rms, drawn log-uniformly
CUTS_TO_JUDGE = 6  # of a campaign: half of them chatter
SPEEDS, DEPTHS = (2500.0, 4400.0), (0.3e-3, 4.5e-3)  # rpm, m: of cuts to be judged, drawn uniformly
CLEAR = 0.05  # a cut to be judged has its largest multiplier farther than this from 1
MOST_DRAWS = 400  # of conditions for one cut to be judged
README = """# Benchmark: what can be told from vibration?

{count} campaigns, `campaigns/NAME/`. In each, a machine was cut with and measured; a model of it is believed.

- `campaign.yaml`: cuts with their conditions; `model.yaml`: what is believed of the machine, each value off by up to a few
  tens of per cent; `cut_N.csv`: displacement (um) and the tachometer's voltage, sampled evenly at the rate of campaign.yaml.
- `judge/`: more cuts of the same machine, some of which chatter, in the same form.

Asked, for every campaign; leave out, or answer null, what you do not know:

1. **Identification**: `natural_frequency` (Hz), `damping_ratio`, `tangential_coefficient` (N/m^2), with 95 % intervals.
2. **Naming**: which physical effects does the model lack? Names as `testbed effects` lists them; `[]`: none is missing.
3. **Chatter**: did each cut of `judge/` chatter?

Answer in one JSON file:

```json
{example}
```

The truth is not in this folder. It was sealed before anybody answered: SHA-256 `{digest}`.
Score with `testbed benchmark FOLDER ANSWERS.json`, where the truth lies beside the folder, or send your answers to whoever
holds it.
"""


def truth_place(folder: Path) -> Path:
    """Where the truth lies unless it is said: beside the folder, not in it."""
    return folder.with_name(f"{folder.name}-truth.json")


def make(folder: Path, count: int, seed: int, show: Callable[[int, int], None]) -> None:
    """Draw and cut the campaigns into a new folder, the truth beside it. InputProblem where one of them is there already."""
    import numpy as np

    from testbed.exports.writing import new_folder
    from testbed.system.atomic import write_text

    secret = truth_place(folder)
    if secret.exists():
        raise InputProblem(secret, "exists already", "it is the truth of an earlier benchmark: choose another folder")
    names = [f"c{number + 1:0{len(str(count))}d}" for number in range(count)]
    bare = np.random.default_rng([1889, seed]).permutation(count)[:round(NONE_HIDDEN * count)].tolist()
    with new_folder(folder) as place:
        truth: dict[str, Any] = {}
        for number, name in enumerate(names):
            truth[name] = _campaign(place / "campaigns" / name, seed, number, number not in bare)
            show(number + 1, count)
        text = json.dumps({"kind": KIND, "seed": seed, "campaigns": truth}, indent=1) + "\n"
        digest = sha256(text.encode()).hexdigest()
        note = {"format": FORMAT, "campaigns": {name: sorted(one["chatter"]) for name, one in truth.items()}, "sealed": digest}
        first = {"parameters": {"natural_frequency": {"value": 146.2, "low": 146.0, "high": 146.4}},
                 "effects": ["process_damping"], "chatter": {"cut_0": True, "cut_1": False}}
        (place / "README.md").write_text(README.format(count=count, digest=digest, example=json.dumps(
            {"campaigns": {names[0]: first}}, indent=1)), encoding="utf-8")
        (place / NOTE).write_text(json.dumps(note, indent=1) + "\n", encoding="utf-8")
        write_text(secret, text)


def _campaign(place: Path, seed: int, number: int, hides: bool) -> dict[str, Any]:
    """Cut one campaign, with a hidden effect or without, and write its files; returns its truth."""
    import math

    import numpy as np

    from testbed.catalogue import catalogue
    from testbed.cli._demo_loop import COUNT, COURSE, CUTS, RATE, draw
    from testbed.cut import Cut
    from testbed.engines.mujoco_engine import simulate
    from testbed.machine import Cutter, Cutting, Model, Structure
    from testbed.workshop import RPM, Measurement, measured_cut, write_campaign

    random = np.random.default_rng([1889, seed, number])
    drawn = draw(int(random.integers(2**62)))
    bare = Model(Structure(2.573, 146.4, 0.0034), Cutter(), Cutting("up-milling", 0.162, 5.5e8, 2.0e8))
    model, believed = bare.with_values(drawn["machine"]), bare.with_values(drawn["believed"])
    hidden = [drawn["effect"]] if hides else []
    if hidden:
        model = model.with_effect(drawn["effect"], **drawn["parameters"])
    noise = math.exp(random.uniform(math.log(NOISES[0]), math.log(NOISES[1])))
    how = Measurement(rate=RATE, noise=noise, count=COUNT, mark_angle=drawn["mark_angle"])
    seeds = random.integers(2**31, size=len(CUTS) + CUTS_TO_JUDGE).tolist()
    records, cut_so_far = [], 0.0
    for (rpm, depth, feed), own in zip(CUTS, seeds, strict=False):
        cut = Cut(rpm * RPM, depth * 1e-3, feed * 1e-3, *COURSE, length_cut_before=cut_so_far)
        records.append(measured_cut(simulate, model, cut, how, own, f"{rpm} rpm, {depth} mm"))
        cut_so_far += round(COURSE[1] * cut.feed_per_tooth, 9)
    chattering = random.permutation([number % 2 == 0 for number in range(CUTS_TO_JUDGE)]).tolist()
    judged = [_to_judge(random, model, catalogue(), wanted, COURSE) for wanted in chattering]
    bounded = model.with_effect("contact_loss")  # what bounds the motion of a cut that chatters
    heard = [measured_cut(simulate, bounded, cut, how, own, f"cut {k}")
             for k, (cut, own) in enumerate(zip(judged, seeds[len(CUTS):], strict=True))]
    for part, cuts in ((place, records), (place / "judge", heard)):
        part.mkdir(parents=True)
        write_campaign(part, cuts, believed, name=place.name)
    return {"parameters": {name: drawn["machine"][name] for name in PARAMETERS}, "effects": hidden,
            "values": drawn["parameters"] if hidden else {}, "noise": noise,
            "chatter": {f"cut_{k}": wanted for k, wanted in enumerate(chattering)}}


def _to_judge(random: Any, model: Any, catalogue: Mapping[str, Any], wanted: bool, course: tuple[int, int, int]) -> Any:
    """Conditions that are clear: the multipliers of the delay equation and the compiled engine's motion both say `wanted`."""
    from dataclasses import replace

    from testbed.analysis.multipliers.run_labels import labels, linear_class
    from testbed.api.multipliers import of_cut as multipliers
    from testbed.cut import Cut, whole_cut_sampling
    from testbed.engines import fast
    from testbed.workshop import RPM

    for _ in range(MOST_DRAWS):
        cut = Cut(random.uniform(*SPEEDS) * RPM, random.uniform(*DEPTHS), random.uniform(0.08e-3, 0.13e-3), *course)
        try:
            found = multipliers(model, cut, catalogue, "benchmark")
        except InputProblem:
            continue
        linear = linear_class(found["multipliers"], found["period_passes"])
        if linear.modulus is None or abs(linear.modulus - 1) < CLEAR or (linear.modulus > 1) != wanted:
            continue
        run = fast.simulate(model.with_effect("contact_loss"), cut, whole_cut_sampling(cut, 1, 6400.0), catalogue=catalogue)
        known = {"idle_passes": course[0], "passes": course[1], "feed_per_tooth": cut.feed_per_tooth, "flutes": 1}
        if run.outcome == "ok" and labels(replace(run, conditions=known), linear, model, {})["chatter"] is wanted:
            return cut
    raise RuntimeError("no cut was found that is clear")  # a fault: of such machines every other cut is


def read(folder: Path) -> dict[str, Any]:
    """The note of a benchmark's folder. InputProblem where it is none."""
    try:
        note = json.loads((folder / NOTE).read_text(encoding="utf-8"))
        whole = isinstance(note["sealed"], str) and all(isinstance(cuts, list) for cuts in note["campaigns"].values())
        newer = int(note["format"]) > FORMAT
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        whole = newer = False
        note = {}
    if newer:
        raise InputProblem(folder, "is of a newer testbed", "update testbed")
    if not whole:
        raise InputProblem(folder, "exists and is no benchmark", "name its folder, or one that does not exist to make one")
    return dict(note)


def open_truth(place: Path, note: Mapping[str, Any]) -> dict[str, Any]:
    """The campaigns of the sealed file. InputProblem where it is not what was sealed."""
    try:
        content = place.read_bytes()
    except OSError as problem:
        raise InputProblem(place, f"cannot be read ({problem.strerror})", "say where the truth is with --truth") from None
    if sha256(content).hexdigest() != note["sealed"]:
        raise InputProblem(place, "is not the truth that was sealed (its hash differs)", "name the right file with --truth")
    return dict(json.loads(content)["campaigns"])
