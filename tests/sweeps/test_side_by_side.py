"""Runs side by side, as arrays: what each of them is alone, to the bit."""

import math
from hashlib import sha256

import numpy as np
import pytest

from testbed.catalogue import catalogue
from testbed.cut import Cut, Cuts, Sampling, whole_cut_sampling
from testbed.engines import fast
from testbed.engines.model_arrays import kind_of
from testbed.engines.packing import pack, pack_many
from testbed.files.yaml_text import parse
from testbed.machine import Cutter, Cutting, Mode, Model, Structure
from testbed.scenario.scenario import _generator
from testbed.scenario.scenario_file import scenario_from
from testbed.scenario.streams import streams
from testbed.store.seal import BLOCK, state, write_sealed
from testbed.sweeps import sweep

EFFECTS = catalogue()
RNG = np.random.default_rng(61)


def random_cut():
    return Cut(*(float(RNG.uniform(*ends)) for ends in ((100, 1000), (0, 4e-3), (5e-5, 2e-4))),
               *(int(RNG.integers(low, high)) for low, high in ((0, 4), (1, 30), (0, 4))), 1e-6 * float(RNG.normal()), 0.1,
               float(RNG.uniform(0, 1)), float(RNG.choice([0, 0.3])), float(RNG.choice([0, 0.2])),
               float(RNG.choice([0, 0.01, 1.0])), bool(RNG.integers(0, 2)))


def random_model(kind):
    """kind: one mode along the feed, several in the plane, or teeth of unequal pitch."""
    flutes, modes = int(RNG.integers(1, 5)), [Mode(1.0, float(RNG.uniform(80, 800)), 0.01)]
    pitches = RNG.uniform(0.8, 1.2, flutes if kind == "uneven" else 0)
    if kind == "plane":
        modes += [Mode(2.0, 300.0 + 150.0 * place, 0.02, float(RNG.uniform(0.1, 1.5)), "tool")
                  for place in range(RNG.integers(1, 4))]
    cutter = Cutter(flutes, 0.019, float(RNG.choice([0.0, 0.5])), tuple((pitches * 2 * math.pi / pitches.sum()).tolist()))
    names = RNG.choice(list(EFFECTS), int(RNG.integers(0, 3)), replace=False)
    return Model(Structure.of(modes), cutter, Cutting("up-milling", float(RNG.uniform(0.05, 0.5))),
                 {str(name): EFFECTS[name].example() for name in names})


@pytest.mark.parametrize("kind", ["one mode", "plane", "uneven"])
@pytest.mark.parametrize("options", [{}, {"steps": 20}, {"stiffening": 2.3, "refinement": 2}])
def test_runs_packed_at_once_are_packed_as_one_by_one(kind, options):
    models = [model for model in (random_model(kind) for _ in range(30)) for _ in range(3)]
    sorts = {kind_of(model, EFFECTS)[:2] for model in models}
    for sort in sorts:
        some = [model for model in models if kind_of(model, EFFECTS)[:2] == sort]
        cuts = [random_cut() for _ in some]
        many = pack_many(some, cuts, EFFECTS, **options)
        for run, (model, cut) in enumerate(zip(some, cuts, strict=True)):
            one = pack(model, cut, EFFECTS, **options)
            for found, name in zip(many.arrays(), "APGIOY", strict=True):
                alone = getattr(one, name)
                assert found[run, : len(alone)].tobytes() == alone.tobytes() and not found[run, len(alone):].any(), name
            if one.turn is not None:
                assert np.array_equal(many.turns[run].steps, one.turn.steps)
    assert len({tuple(row) for row in many.I.tolist()}) > 3  # they differ


def test_cuts_in_columns_are_the_cuts():
    cuts = [random_cut() for _ in range(20)]
    columns = Cuts.of(cuts)
    assert list(columns) == cuts and list(columns[3:7]) == cuts[3:7] and list(columns.some([5, 2])) == [cuts[5], cuts[2]]
    assert columns.total_passes.tolist() == [cut.total_passes for cut in cuts]
    assert list(Cuts.alike(2, spindle_speed=[300.0, 400.0], axial_depth_of_cut=1e-3)) == [Cut(300.0, 1e-3), Cut(400.0, 1e-3)]
    for wrong in ([300.0, math.nan], [-1.0, 300.0]):
        with pytest.raises(ValueError, match="spindle_speed"):
            Cuts.alike(2, spindle_speed=wrong, axial_depth_of_cut=1e-3)


def test_a_run_of_which_no_record_is_kept_is_the_run_with_a_record():
    """Sixteen go side by side: of several machines, partial passes and courses, some held, some that diverge."""
    models = [Model(Structure(2.5, 150.0, 0.003), Cutter(flutes, 0.019, helix), Cutting("down-milling", immersion))
              for flutes in (1, 3) for helix in (0.0, 0.4) for immersion in (0.1, 0.5)]
    models = [model for model in models for _ in range(40)]
    cuts = [random_cut() for _ in models]
    cuts += [Cut(380.0, 0.02, passes=40)] * 20
    models += [models[0]] * 20
    record, silent = (fast.simulate_batch(models, cuts, samplings) for samplings in ([Sampling(1.0, 1)] * len(cuts), None))
    assert silent.out.shape[2] == 0 and 20 <= (silent.outcome != 0).sum() < 100
    for name in ("pass_times", "pass_states", "outcome", "outcome_time"):
        assert np.array_equal(getattr(silent, name), getattr(record, name), equal_nan=True), name
    assert np.nanstd(silent.pass_states[:, 1, 0]) > 1e-7


def test_runs_simulated_side_by_side_are_the_same_as_one_at_a_time():
    base = Model(Structure(2.573, 146.5976, 0.0032), Cutter(2, 19.05e-3, 0.3), Cutting())
    kinds = [base, base.with_effect("contact_loss"),
             base.with_effect("ambient_vibration", amplitude=1e-6, frequency=50.0, phase=0.1),
             base.with_effect("process_damping", coefficient=1e5).with_effect("sensor_lag", time_constant=1e-4)]
    for channels in (("displacement",), ("displacement", "acceleration"), ("force_x", "displacement_y")):
        models = [model for model in kinds for _ in range(3)]
        cuts = Cuts.alike(len(models), spindle_speed=np.tile([390.0, 400.0, 310.0], 4),
                          axial_depth_of_cut=np.tile([1e-4, 0.5, 1e-3], 4), passes=25, idle_passes=3, initial_displacement=1e-5)
        samplings = [whole_cut_sampling(cut, 2, 12_800.0) for cut in cuts]
        many = fast.simulate_side_by_side(models, cuts, np.array([one.count for one in samplings]), 12_800.0, channels=channels)
        assert {"ok", "diverged"} == set(many.outcome)
        for run, (model, cut, sampling) in enumerate(zip(models, cuts, samplings, strict=True)):
            alone = fast.simulate(model, cut, sampling, channels=channels)
            for name in channels:
                assert many.channels[name][run, : sampling.count].tobytes() == alone.channels[name].tobytes(), (run, name)
            assert many.marks[run].tobytes() == alone.marks.tobytes()
            assert many.pass_times[run].tobytes() == alone.pass_times.tobytes()
            assert many.outcome[run] == alone.outcome
            np.testing.assert_equal(many.outcome_time[run], alone.outcome_time)


@pytest.mark.parametrize("seed", [0, 7, 2**32 - 1, 2**100 + 3, 2**140 + 1])
def test_streams_begun_at_once_are_numpys_own(seed):
    indices = np.array([0, 1, 77, 10**6, 2**32 - 1])
    for purpose in (0, 1, 2):
        for index, found in zip(indices.tolist(), streams(seed, indices, purpose), strict=True):
            wanted = _generator(seed, index, purpose)
            assert found.bit_generator.state == wanted.bit_generator.state
            assert found.standard_normal(5).tolist() == wanted.standard_normal(5).tolist()


SWEEP = """name: trial
seed: 5
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.6 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 2, diameter: 19.05 mm, helix_angle: 30 deg}
  cutting: {immersion: 0.1, tangential_coefficient: 550 N/mm^2, normal_coefficient: 200 N/mm^2}
  EFFECTS
cut: {cutting: 8 rev, spread: {displacement: 5 um}}
SWEEP
sensors:
  sampling_rate: 4 kHz
  displacement: {noise: NOISE}
  velocity: {noise: 0 m/s, bits: 16, range: 1 m/s}
"""
GRID = "sweep:\n  spindle_speed: {from: 3000 rpm, to: 6000 rpm, count: 4}\n  depth_of_cut: {from: 1 mm, to: 30 mm, count: 5}"
BOX = "sample:\n  method: latin_hypercube\n  runs: 20\n  over:\n    spindle_speed: {from: 3000 rpm, to: 6000 rpm}\n" \
      "    depth_of_cut: {from: 1 mm, to: 3 mm}\n    damping_ratio: {from: 0.003, to: 0.03}"


def one_by_one(model, cut, sampling, **options):
    """The engine without its other road."""
    return fast.simulate(model, cut, sampling, **options)


@pytest.mark.parametrize(("design", "noise", "effects"), [
    (GRID, "0 m", ""), (GRID, "[0 m, 1 um]", "effects: {contact_loss: {}}"),
    (BOX, "1 um", "effects: {runout: {offset: 5 um, angle: 0.3 rad}}")])
def test_a_sweep_of_arrays_has_the_content_of_one_run_by_run(tmp_path, design, noise, effects):
    text = SWEEP.replace("SWEEP", design).replace("NOISE", noise)
    text = text.replace("  EFFECTS\n", f"  {effects}\n" if effects else "")
    given = scenario_from(parse(text, "s.yaml"))
    found = sweep.run(given, fast.simulate, tmp_path / "a.h5", workers=2)
    plain = sweep.run(given, one_by_one, tmp_path / "b.h5")
    assert found.content_hash == plain.content_hash and found.outcomes == plain.outcomes and found.runs >= 20


def test_a_seal_of_an_older_file_still_counts(tmp_path):
    """It has SHA-256 where a new one has sums; of both a single wrong bit is noticed."""
    content = RNG.bytes(BLOCK + 12_345)
    old, new = tmp_path / "old.h5", tmp_path / "new.h5"
    digest = sha256(sha256(content[:BLOCK]).digest() + sha256(content[BLOCK:]).digest()).hexdigest()
    old.write_bytes(content + f"\nsealed sha256-16M {digest} {len(content):015d}\n".encode())
    write_sealed(new, content)
    for path in (old, new):
        assert state(path) == state(path, 2) == "whole"
        for place in (0, 8_191, BLOCK - 1, BLOCK + 12_344):
            broken = bytearray(path.read_bytes())
            broken[place] ^= 128
            path.with_suffix(".bad").write_bytes(broken)
            assert state(path.with_suffix(".bad")) == "broken"
