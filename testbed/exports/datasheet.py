"""The datasheet: how the set was made, what it is good for and what it must not be used for, and its licence.

After Gebru et al. (2021), Datasheets for datasets, Commun. ACM 64 (12), 86-92.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from testbed.exports.card import GROUPS

_TEXT = """# Datasheet: {name}

## Why

To train and test methods that name chatter, identify a machine or notice missing physics from a milling transient, where
the truth is known for every run.

## What is in it

{runs} simulated cuts, {a_row}; {outcomes}. Signals are what a simulated sensor gave: {channels}, at {rate:g} Hz,
with the sensor's own noise{filtered}. Nothing is measured. No person appears in it. Runs that ended early are kept, with
their outcome; leave them out by `outcome == "ok"`.

## How it was made

By `testbed run` with the {engine} engine, seed {seed}, from the scenario and model below; then `testbed export`. Content
hash of the data set: `{content_hash}`. Versions: {versions}. Every run can be made again from these, bit by bit.

Labels: `stability` and the multiplier come from the characteristic multipliers of the true machine, effects and all,
linearised about its periodic motion; `behaviour` from the recorded once-per-tooth samples alone (of the displacement; where
it was not recorded, of the velocity, the acceleration or a force, the part that changes most from tooth to tooth). The two can
differ: near the border a short cut has not made up its mind, a loud sensor hides a small motion, and a large motion is not
linear.
`label` is that class, and `chatter` says whether it is neimark_sacker or flip, where `behaviour` does not show the
contrary; else the label is unknown and `chatter` null. It says what the cut does in the end: soon after the entry of an
unstable cut chatter is still small, and a stable cut still swings from its entry, which is no chatter.{windows}
`contact_loss` is found from the recorded displacement and the surface that earlier teeth left, the nominal edges taken
(runout is not followed, and the believed immersion is taken). A gap smaller than six rms of the noise is not seen. Without a
recorded displacement it is null: not known, which is not "no".
In a machine without the effect `contact_loss` the force of such a tooth goes on with the wrong sign: there the
label marks where the simulation ceases to be physical.

## What it must not be used for

- To vouch for a real machine's safety, or as the only ground of a stability limit on a shop floor: every run comes from one
  family of models (the modes of the model below, linear force law, plus the effects listed), and real machines have more.
- To claim accuracy on measured data. Sensors, clamping, material and wear of a real rig are not in it.
- To score a method on rows drawn at random: use the splits, which hold out whole {groups}.
- With `truth`, `simulation` or label columns as inputs: `pass_times` and `noise_*` are not known of a real cut.
- To learn absolute rates of chatter: the conditions were chosen by whoever wrote the scenario.

## Licence

{licence}. The program that made it is under the MIT licence.

## The scenario

```yaml
{scenario}
```

## The model

```yaml
{model}
```
"""
_A_ROW = "in windows of {length} samples, one a row, each {step} samples after the one before"
_WINDOWS = """
A window wholly in the cut has its run's label. Before the entry and after the exit it is `no_cut`, without chatter; across
them it is unknown for runs of every class, so that no class loses more windows than another. Windows with a sample that is
no number are left out."""


def datasheet(content: Mapping[str, Any], scenario: str, model: str) -> str:
    """DATASHEET.md from the content of `export.json` and the texts of scenario and model."""
    about = content["about"]
    outcomes = ", ".join(f"{count} ended {name}" for name, count in sorted(content["outcomes"].items()))
    signals = [f"{column['name']} ({column['unit']})" for column in content["columns"] if column["kind"] == "float32 list"]
    window, recorded = about.get("window"), about.get("recorded_at")
    return _TEXT.format(name=about["name"], runs=content["runs"], outcomes=outcomes, groups=GROUPS[about["split_by"]],
                        a_row=_A_ROW.format(**window) if window else "one a row", windows=_WINDOWS if window else "",
                        filtered=f", low-passed from {recorded:g} Hz (`noise_*` is the rms before)" if recorded else "",
                        channels=", ".join(signals), rate=about["sampling_rate"], engine=about["engine"], seed=about["seed"],
                        content_hash=about["source_content_hash"], licence=content["licence"],
                        versions=", ".join(f"{name} {version}" for name, version in sorted(about["versions"].items())),
                        scenario=scenario.strip(), model=model.strip())
