"""Pages quote what the committed results give, and no other number of that kind."""

import re
from pathlib import Path

import pytest

from benchmarks import recount
from benchmarks.allowed_numbers import ALLOWED
from benchmarks.quotes import QUOTES, Number
from benchmarks.recount import NOT_RUN, ROOT, Quote, loose_numbers, places, recounted

GENERATED = {"docs/leaderboard.md"}  # by ``make leaderboard``; a test compares it
CHECKED = [
    path.relative_to(ROOT).as_posix()
    for folder in ("docs", "midnet_bench/docs")
    for path in sorted((ROOT / folder).rglob("*.md"))
]


def test_every_number_that_a_page_quotes_is_that_of_the_results(capsys: pytest.CaptureFixture[str]) -> None:
    """After new results: ``python -m benchmarks.recount --write``."""
    code, lines = recount.main([]), capsys.readouterr().out.splitlines()
    assert [line for line in lines if " = " not in line] == []
    assert code == 0
    assert len(lines) > 800


def test_each_page_is_looked_at() -> None:
    assert {"README.md", "results/README.md", *CHECKED} - GENERATED == set(ALLOWED)
    assert {quote.page for quote in QUOTES} <= set(ALLOWED)


TEXT = """# Title

One robot has 0.987 [0.984,
0.990] and 95 % of 118 476 frames (a window of 3.5 m, `0.5`).

| five | 0.946 | **+0.031 [0.021, 0.043]** | not run |
"""


def quoted(*numbers: object) -> Quote:
    return Quote("page.md", "has {:.3f} and {:.0%} of {:s} frames", lambda: numbers)


def test_a_number_that_differs_is_found_and_replaced() -> None:
    found = places(quoted(Number(0.9871, 0.9840, 0.9902), 0.941, "118 476"), TEXT)
    assert [place.agrees for place in found] == [True, False, True]
    assert recounted(TEXT, found) == TEXT.replace("95 %", "94 %")


def test_a_cell_may_be_bold_or_not_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    row = Quote("", "| five | {:.3f} | {:+.3f} | {:.2f} |", lambda: [0.95, Number(-0.1, -0.2, 0.0), 1.0])
    assert [place.quoted for place in places(row, TEXT)] == ["0.946", "**+0.031 [0.021, 0.043]**", NOT_RUN]
    assert "| five | 0.950 | -0.100 [-0.200, 0.000] | 1.00 |" in recounted(TEXT, places(row, TEXT))
    monkeypatch.setattr(recount, "ROOT", tmp_path)
    later = Quote("", row.template, row.numbers, "later")
    assert {place.recomputed for place in places(later, TEXT)} == {NOT_RUN}


@pytest.mark.parametrize(
    "template", ["has {} and", "frames (a window of {} m, `0.5`).", "five robots have {}"]
)
def test_words_that_are_there_once_or_not(template: str) -> None:
    quote, count = Quote("page.md", template, lambda: [1.0]), 0 if "five" in template else 1
    if count:
        assert len(places(quote, TEXT)) == 1
    else:
        with pytest.raises(ValueError, match="stands there 0 times"):
            places(quote, TEXT)
    with pytest.raises(ValueError, match=rf"stands there {2 * count} times"):
        places(quote, TEXT + TEXT)


def test_a_number_outside_of_quotes_and_allowed_phrases_is_found() -> None:
    found = places(quoted(0.987, 0.95, "118 476"), TEXT)
    loose = list(loose_numbers(TEXT, found, ["window of 3.5 m", "12 of 20"]))
    assert [re.sub(r" \(.*", "", line) for line in loose] == [
        "allowed, and not there: 12 of 20",
        "line 6: 0.946",
        "line 6: +0.031",
        "line 6: 0.021",
        "line 6: 0.043",
    ]
