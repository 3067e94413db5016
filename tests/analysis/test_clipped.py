"""A channel that was clipped: no fit counts what it could not measure, so that intervals hold the truth."""

from dataclasses import replace

import numpy as np

from testbed.analysis.fit.observe import observe
from tests.validation.spoiled import KINDS, campaign, judged


def test_intervals_of_a_campaign_clipped_by_half_hold_the_truth():
    found = judged(606, "clipped by half")
    assert found["error"] < 1.1 and "missed" not in found.values()


def test_what_is_clipped_does_not_count_nor_what_lies_beside_it():
    _, believed, (record, *_) = campaign(601, KINDS["clipped by half"])
    seen, values = observe(record, believed), record.recording.channels["displacement"]
    stuck = (values == values.max()) | (values == values.min())
    assert seen.mask is not None and not seen.mask[stuck].any()
    first = int(np.argmax(stuck))
    assert not seen.mask[first - 2 : first].any() and seen.mask[first - 20]


def test_a_record_that_stands_still_most_of_the_time_counts_as_it_is():
    _, believed, (record, *_) = campaign(601, KINDS["as it was"])
    assert observe(record, believed).mask is None
    values = record.recording.channels["displacement"]
    low = np.maximum(values, np.quantile(values, 0.6))
    still = replace(record, recording=replace(record.recording, channels={"displacement": low}))
    assert observe(still, believed).mask is None
