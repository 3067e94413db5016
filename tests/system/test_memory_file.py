"""Files in memory: what a file holds, whatever their memory held before."""

import io

import numpy as np

from testbed.system.memory_file import MemoryFile, release


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
