"""The random numbers of many runs: numpy's own streams, begun many at a time.

Run `index` draws from PCG64 on SeedSequence(seed, spawn_key=(index, purpose)). To make these objects one by one takes longer
than what most runs draw. Here the seed sequences are worked out side by side, and one generator is set to each in turn.
Source: the algorithms of numpy.random.SeedSequence (M. O'Neill, "Developing a seed_seq alternative", 2015) and of PCG64's
seeding (O'Neill 2014, HMC-CS-2014-0905), which numpy promises not to change (NEP 19).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

_POOL = 4  # words of 32 bits
_INIT_A, _MULT_A, _INIT_B, _MULT_B = 0x43B0D7E5, 0x931E8875, 0x8B51F9DD, 0x58F38DED
_LEFT, _RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
_STEP = 0x2360ED051FC65DA44385DF649FCCF645  # PCG64's multiplier
_WORD, _WIDE = 2**32 - 1, 2**128 - 1


class _Hash:
    """SeedSequence's hash of words, whose constant moves on at each use."""

    def __init__(self, begin: int, factor: int) -> None:
        self.constant, self.factor = begin, factor

    def __call__(self, words: np.ndarray) -> np.ndarray:
        words = words ^ np.uint32(self.constant)
        self.constant = self.constant * self.factor & _WORD
        return _folded(words * np.uint32(self.constant))


def _mixed(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return _folded(_LEFT * one - _RIGHT * other)


def _folded(words: np.ndarray) -> np.ndarray:
    return np.bitwise_xor(words, np.right_shift(words, 16))


def seed_words(seed: int, indices: np.ndarray, purpose: int) -> np.ndarray:
    """SeedSequence(seed, spawn_key=(index, purpose)).generate_state(4, uint64) for every index below 2^32, (indices, 4)."""
    words = [seed >> place & _WORD for place in range(0, max(1, seed.bit_length()), 32)]
    words += [0] * (_POOL - len(words))
    entropy = [np.array([word], np.uint32) for word in words] + [indices.astype(np.uint32), np.array([purpose], np.uint32)]
    hashed = _Hash(_INIT_A, _MULT_A)
    pool = [hashed(word) for word in entropy[:_POOL]]
    for source in range(_POOL):
        for place in range(_POOL):
            if place != source:
                pool[place] = _mixed(pool[place], hashed(pool[source]))
    for word in entropy[_POOL:]:
        for place in range(_POOL):
            pool[place] = _mixed(pool[place], hashed(word))
    hashed = _Hash(_INIT_B, _MULT_B)
    found = np.stack([hashed(pool[place % _POOL]) for place in range(2 * _POOL)], axis=1).astype(np.uint64)
    return found[:, ::2] | found[:, 1::2] << np.uint64(32)


def streams(seed: int, indices: np.ndarray, purpose: int) -> Iterator[np.random.Generator]:
    """Each run's random numbers, in turn: one and the same generator, good until the next is asked for."""
    bits = np.random.PCG64(0)
    generator = np.random.Generator(bits)
    for high, low, first, second in seed_words(seed, indices, purpose).tolist():
        step = (first << 65 | second << 1 | 1) & _WIDE
        state = ((high << 64 | low) + step) * _STEP + step & _WIDE
        bits.state = {"bit_generator": "PCG64", "state": {"state": state, "inc": step}, "has_uint32": 0, "uinteger": 0}
        yield generator
