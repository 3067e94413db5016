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
