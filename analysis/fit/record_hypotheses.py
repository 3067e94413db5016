"""What of the records a fit takes otherwise than the campaign states it, because that explains them better."""

from __future__ import annotations

from collections.abc import Sequence

from testbed.analysis.fit.length_cut import length_note
from testbed.analysis.fit.moves.entry_history import front_note
from testbed.analysis.fit.moves.table_feed import feed_note
from testbed.analysis.fit.observed import Observed
from testbed.analysis.fit.thinning import thinned_note


def taken_notes(records: Sequence[Observed], used: Sequence[Observed]) -> list[str]:
    """In words, a line each. used: the records, or some of them, as a fit has them, by the same names."""
    stated = {record.name: record for record in records}
    same = [stated[record.name] for record in used]
    return [*_turned_note(used), *thinned_note(used), *length_note(same, used), *feed_note(same, used), *front_note(same, used)]


def _turned_note(used: Sequence[Observed]) -> list[str]:
    names = ", ".join(f"{one.name} ({' and '.join(one.turned)})" for one in used if one.turned)
    return [f"{names}: the response moves against the force, so the sensor, or the hammer's sign, is turned round; fitted with "
            "its sign turned: if that is how it was, give the channel, or the force, scale: -1"] if names else []
