"""The first page of VALIDATION.md says what its sections say."""

import re
from pathlib import Path

from tests.validation import first_page, run

TEXT = (Path(__file__).parents[2] / "VALIDATION.md").read_text()
SECTIONS = run._merged(TEXT, [])
ADDED = """## Taps (as made)

tests/validation/taps.py, 1 s

| claim | target | found |  | remark |
| --- | --- | --- | --- | --- |
| \\|mu\\| found | <= 1 | 2 | MISSED | off |
| another | 0 | 0 | passed |  |
"""


def test_the_page_is_that_of_its_sections():
    assert run.whole(TEXT) == TEXT, "write it again: python -m tests.validation.run page"


def test_the_page_is_short_and_has_a_line_for_each_section():
    page = TEXT.split("\n" + SECTIONS[0])[0]
    assert page.count("\n") <= 100 and len(SECTIONS) > 30
    for one in SECTIONS:
        title = one.split("\n", 1)[0].removeprefix("## ")
        assert page.count("\n| " + first_page._link(title)) >= 1, title


def test_headlines_are_claims_of_their_sections_and_numbers_by_hand_stand_there():
    by_title = {one.split("\n", 1)[0].removeprefix("## "): one for one in SECTIONS}
    for title, what in first_page.HEADLINES.items():
        assert what in {one.what for one in first_page.claims(by_title[title])}, title
    for title, told in first_page.BY_HAND.items():
        assert not first_page.claims(by_title[title])
        numbers = re.findall(r"\d+(?:\.\d+)?", told.target + told.found)
        assert numbers and all(re.search(rf"(?<![\d.]){re.escape(one)}(?!\d)", by_title[title]) for one in numbers), title


def test_a_missed_claim_and_its_count_are_on_the_page():
    whole = run.whole(TEXT, [ADDED])
    assert "| [Taps](#taps-as-made) | \\|mu\\| found | <= 1 | 2 | 1 of 2 | `taps` |" in whole
    assert "| [Taps](#taps-as-made) | \\|mu\\| found | <= 1 | 2 |\n" in whole
    before, after = (int(re.search(r"Claims missed: (\d+)", one)[1]) for one in (TEXT, whole))
    assert after == before + 1 and run.whole(whole) == whole


def test_a_check_without_a_section_is_told():
    assert "Checks that have no section here: `never_run`." in first_page.page(SECTIONS, ["taps", "never_run"], "")
