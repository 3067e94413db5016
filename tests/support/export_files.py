"""A small data set and its export, for the tests of `testbed export`."""

from testbed.cli import main

SCENARIO = """name: small sweep
seed: 5
repeats: 2
model:
  structure: {mass: 2.573 kg, natural_frequency: 146.5976 Hz, damping_ratio: 0.0032}
  cutter: {flutes: 1, diameter: 19.05 mm}
  cutting: {immersion: 0.162, tangential_coefficient: 555.768 N/mm^2, normal_coefficient: 166.7304 N/mm^2}
  effects: {contact_loss: {}}
cut: {idle: 0 rev, cutting: 60 rev, ring_down: 10 rev, spread: {displacement: 5 um, velocity: 0 m/s}}
sweep:
  spindle_speed: {from: 2600 rpm, to: 4400 rpm, count: 6}
  depth_of_cut: {from: 0.4 mm, to: 3.6 mm, count: 4}
sensors:
  sampling_rate: 6400 Hz
  mark_angle: 40 deg
  displacement: {noise: 0.5 um, bits: 16, range: 5 mm}
"""


def run(*arguments):
    """Exit code of a command line."""
    try:
        main([str(argument) for argument in arguments])
    except SystemExit as stop:
        return stop.code


def simulate(folder, text=SCENARIO, name="small"):
    """The data set of a scenario's text."""
    (folder / f"{name}.yaml").write_text(text)
    assert run("run", folder / f"{name}.yaml", "-o", folder / f"{name}.h5", "--quiet") == 0
    return folder / f"{name}.h5"


def export(folder):
    """(data set, exported folder)."""
    data = simulate(folder)
    assert run("export", data, "-o", folder / "set", "--quiet") == 0
    return data, folder / "set"
