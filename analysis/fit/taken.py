"""What of the records a fit took otherwise than the campaign states it, because that explains them better."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.fit.length_cut import length_note
from analysis.fit.observed import Observed
from analysis.fit.table_feed import feed_note


def taken_notes(records: Sequence[Observed], used: Sequence[Observed]) -> list[str]:
    """In words, a line each. used: the records, or some of them, as a fit has them, by the same names."""
    stated = {record.name: record for record in records}
    same = [stated[record.name] for record in used]
    return [*length_note(same, used), *feed_note(same, used)]
