"""Files in memory, and runs simulated together: the same bytes as one at a time."""

import io
from dataclasses import replace

import numpy as np

from testbed.batch import simulate_runs
from testbed.cut import Cut, whole_cut_sampling
from testbed.engines.fast import simulate
from testbed.machine import Cutter, Cutting, Model, Structure
from testbed.memory_file import MemoryFile, release
from testbed.scenario import Run
from testbed.sensors.chain import ChannelSensor, SensorChain


def test_a_file_in_memory_holds_what_a_file_holds_whatever_its_memory_held_before():
    rng = np.random.default_rng(5)
    with MemoryFile(5_000, keep=True) as first:
        first.write(memoryview(b"\xff" * 5_000))
    with MemoryFile(10, keep=True) as file:
        assert file.room is first.room
        other = io.BytesIO()
        for _ in range(400):
            place, size, step = (int(value) for value in rng.integers((0, 0, 0), (9_000, 700, 4)))
            data = rng.bytes(size)
            if step == 3:
                size = place
                grown = max(0, size - len(other.getvalue()))
                file.truncate(size)
                other.truncate(size)
                other.seek(0, io.SEEK_END)
                other.write(bytes(grown))
            else:
                file.seek(place)
                other.seek(place)
                assert file.write(memoryview(data)) == other.write(data)
            assert bytes(file.content()) == other.getvalue()
            read, wanted = bytearray(500), bytearray(500)
            file.seek(place)
            other.seek(place)
            assert file.readinto(memoryview(read)) == other.readinto(wanted) and read == wanted
            assert file.tell() == other.tell() and file.seek(0, io.SEEK_END) == other.seek(0, io.SEEK_END)
    release()
    with MemoryFile(10, keep=True) as file:
        assert len(file.room) == 10


def test_runs_simulated_together_are_the_same_as_one_at_a_time():
    model = Model(Structure(2.573, 146.5976, 0.0032), Cutter(2, 19.05e-3, 0.3), Cutting())
    sensors = SensorChain({"displacement": ChannelSensor(noise=1e-7)}, mark_angle=0.4)
    runs = []
    for index, (speed, depth) in enumerate([(390.0, 1e-4), (400.0, 2e-3), (410.0, 0.9), (300.0, 1e-3)]):  # one diverges
        cut = Cut(speed, depth, passes=40, idle_passes=3, initial_displacement=1e-5)
        runs.append(Run(index, model, cut, whole_cut_sampling(cut, 2, 12_800.0), sensors, 7))
    runs.append(replace(runs[0], index=4, cut=replace(runs[0].cut, passes=20), sampling=runs[3].sampling))
    together = list(simulate_runs(runs, simulate))
    alone = [next(simulate_runs([run], simulate)) for run in runs]
    assert {one.outcome for one in alone} == {"ok", "diverged"}
    for one, other in zip(together, alone, strict=True):
        assert one.channels["displacement"].tobytes() == other.channels["displacement"].tobytes()
        assert one.marks.tobytes() == other.marks.tobytes() and one.pass_times.tobytes() == other.pass_times.tobytes()
        assert (one.outcome, one.start, len(one)) == (other.outcome, other.start, len(other))
        np.testing.assert_equal(one.outcome_time, other.outcome_time)
        assert one.conditions["pass_states"].tobytes() == other.conditions["pass_states"].tobytes()
