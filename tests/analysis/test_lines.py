"""Lines of a spectrum: what chance shows is none."""

import numpy as np

from testbed.analysis.records.lines import standing_out


def test_white_noise_has_no_lines_at_the_ends_of_its_spectrum():
    """What is beyond an end is the spectrum mirrored, not its last value again."""
    found = [frequency for seed in range(40) for frequency, _, _ in
             standing_out(np.random.default_rng(seed).standard_normal(5000), 10000.0)]
    assert len(found) < 20 and sum(frequency < 200.0 or frequency > 4800.0 for frequency in found) <= 2
    long = np.random.default_rng(7).standard_normal((8, 400_000))
    assert sum(len(standing_out(row, 50000.0)) for row in long) <= 3  # some fifty, were no more asked of them


def test_what_is_slower_than_any_line_has_no_lines_beside_it():
    """A decay without noise: what its straight line leaves at 0 Hz has side lobes."""
    time = np.arange(4000) / 5000.0
    decay = np.sin(2.0 * np.pi * 150.0 * time) * np.exp(-20.0 * time)
    assert [round(frequency) for frequency, _, _ in standing_out(decay, 5000.0)] == [150]
    for cycles in (4.0, 4.5, 5.0, 7.0):  # and a slow line is one
        noisy = np.sin(2.0 * np.pi * cycles * time / 0.8) + 0.05 * np.random.default_rng(1).standard_normal(4000)
        assert abs(standing_out(noisy, 5000.0)[0][0] * 0.8 - cycles) < 0.1
