"""The numbers that pages quote, computed again from the committed results.

``python -m benchmarks.recount`` prints each quoted number beside the recomputed one and exits with 1 if any
differs, or if a page has a number of the kind that results have outside of every quote. ``--write`` puts the
recomputed ones into the pages.

``benchmarks/quotes.py`` has the quotes, ``benchmarks/allowed_numbers.py`` what needs none. A template is the
text of a page with a format specification in the place of each number, and ``{:s}`` in that of words; any
white space in it matches any white space on the page, line breaks too.
"""

import argparse
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
NOT_RUN = "not run"
"""stands on a page for a number whose campaign has not been run"""


@dataclass(frozen=True)
class Quote:
    """A part of a page: ``template.format(*numbers())``."""

    page: str  # from the repository's root
    template: str
    numbers: Callable[[], Sequence[Any]]  # what the places of the template take; read when it is needed
    folder: str = ""  # of the results; without it on disk each place says NOT_RUN


class Place(NamedTuple):
    """A number on a page."""

    start: int
    end: int
    quoted: str
    recomputed: str
    row: tuple[int, int] | None = None  # of a table, where the number is in one

    @property
    def agrees(self) -> bool:
        """Whether the page has what was computed, but for line breaks."""
        return self.quoted.split() == self.recomputed.split()


_PLACE = re.compile(r"\{:?([^{}]*)\}")
_NUMBER = rf"(\**[-+]?\d+(?:[ .]\d+)*(?:\s?%)?(?:\s+\[[^\]]*\])?\**|identical|nan|{NOT_RUN})"
_WORDS = r"((?:(?!\n\n)[^|.]){1,80})"  # within a sentence and a cell


def places(quote: Quote, text: str) -> list[Place]:
    """Where the numbers of a quote are on its page, and what they are.

    Raises:
        ValueError: the page has the template's words nowhere, or twice.
    """
    words = _PLACE.split(quote.template)
    parts = [_WORDS if part == "s" else _NUMBER for part in words]
    parts[::2] = [r"\s+".join(map(re.escape, re.split(r"\s+", word))) for word in words[::2]]
    # a row of a table is a whole line
    begin = "^" if quote.template[0] == "|" else r"(?<![\w.])"
    end = "$" if quote.template[-1] == "|" else r"(?!\w)"
    found = list(re.finditer(begin + "".join(parts) + end, text, re.M))
    if len(found) != 1:
        raise ValueError(f"{quote.page}: stands there {len(found)} times: {quote.template}")
    if quote.folder and not (ROOT / "results/reference" / quote.folder).exists():
        recomputed = [NOT_RUN] * (len(words) // 2)
    else:
        numbers = quote.numbers()
        if len(numbers) != len(words) // 2:
            raise ValueError(f"{quote.page}: {len(numbers)} numbers for: {quote.template}")
        recomputed = [_formatted(number, form) for number, form in zip(numbers, words[1::2], strict=True)]
    row = found[0].span() if quote.template[0] == "|" else None
    return [Place(*found[0].span(i), found[0][i], new, row) for i, new in enumerate(recomputed, 1)]


def _formatted(number: Any, form: str) -> str:
    """With a space before the percent sign and, where the form has a comma, between thousands."""
    text = format(number, form).replace("%", " %")
    return text.replace(",", " ") if "," in form else text


_CODE = re.compile(r"```.*?```|^    .*?$|`[^`\n]*`|\]\([^)]*\)|!\[[^\]]*\]|<!--.*?-->", re.S | re.M)
_UNITS = r"%|ms|mm|cm|km|s|m|h|minutes?|hours?|points?|times|MB|GB|steps|rad|degrees|percent"
_RESULT = re.compile(
    rf"""
      (?<![\w.]) [-+]?
      (?: \d+\.\d+ (?:\ ?(?:{_UNITS})(?!\w))?  # a decimal
        | \d{{1,3}}(?:[ ]\d{{3}})+             # thousands
        | \d+\s(?:{_UNITS})(?!\w) | \d+\ ?%    # with a unit
        | \d+\sof\s\d+                         # a share
      )
    """,
    re.X,
)


def loose_numbers(text: str, quoted: Sequence[Place], allowed: Sequence[str]) -> Iterator[str]:
    """Numbers of the kind that results have, outside of quotes, code and the phrases that are allowed."""
    covered = [span.span() for span in _CODE.finditer(text)]
    covered += [place.row or (place.start, place.end) for place in quoted]  # a row's head is in the quote
    for phrase in allowed:
        pattern = r"(?<![\w.])" + r"\s+".join(map(re.escape, phrase.split())) + r"(?!\w|\.\d)"
        spans = [found.span() for found in re.finditer(pattern, text)]
        if not spans:
            yield f"allowed, and not there: {phrase}"
        covered += spans
    for found in _RESULT.finditer(text):
        if not any(start <= found.start() < end for start, end in covered):
            line = text.count("\n", 0, found.start()) + 1
            near = " ".join(text[max(0, found.start() - 30) : found.end() + 20].split())
            yield f"line {line}: {' '.join(found[0].split())} (... {near} ...)"


def recounted(text: str, quoted: Sequence[Place]) -> str:
    """The page with the recomputed numbers."""
    for place in sorted(quoted, reverse=True):
        if not place.agrees:
            text = text[: place.start] + place.recomputed + text[place.end :]
    return text


def main(arguments: Sequence[str] | None = None) -> int:
    from benchmarks.allowed_numbers import ALLOWED
    from benchmarks.quotes import QUOTES

    parser = argparse.ArgumentParser(prog="python -m benchmarks.recount", description=__doc__)
    parser.add_argument("--write", action="store_true", help="put the recomputed numbers into the pages")
    options = parser.parse_args(arguments)
    faults = 0
    for page, allowed in ALLOWED.items():
        text, quoted = (ROOT / page).read_text(encoding="utf-8"), list[Place]()
        for quote in (quote for quote in QUOTES if quote.page == page):
            try:
                quoted += places(quote, text)
            except (ValueError, LookupError, OSError) as error:
                faults += 1
                print(f"{page}: {error if isinstance(error, ValueError) else repr(error)}")
        for place in quoted:
            faults += not place.agrees and not options.write
            line, sign = text.count("\n", 0, place.start) + 1, "=" if place.agrees else "!="
            print(f"{page}:{line}: {' '.join(place.quoted.split())} {sign} {place.recomputed}")
        for loose in loose_numbers(text, quoted, allowed):
            faults += 1
            print(f"{page}: no quote has {loose}")
        if options.write and any(not place.agrees for place in quoted):
            (ROOT / page).write_text(recounted(text, quoted), encoding="utf-8")
    return min(faults, 1)


if __name__ == "__main__":
    sys.exit(main())
