"""Writes the columns of the trials' tables into ``docs/results.md`` from their declarations: ``make api``."""

import re
import textwrap
from itertools import chain
from pathlib import Path

from midnet_bench.campaign.trial import TIMING_TABLE, Columns
from midnet_bench.experiments.columns import DETECTION, LABYRINTH, MAPPING

PAGE = Path(__file__).with_name("results.md")
BLOCK = re.compile(r"^\*\*`(\w+)`\*\* .*?\n(?=\n)", re.M | re.S)  # a table's paragraph
TABLES = dict(chain(TIMING_TABLE.items(), MAPPING.items(), LABYRINTH.items(), DETECTION.items()))


def page(text: str) -> str:
    """The page, with the paragraphs of the trials' tables made anew."""
    return BLOCK.sub(
        lambda found: block(found[1], TABLES[found[1]]) if found[1] in TABLES else found[0], text
    )


def block(name: str, table: Columns) -> str:
    """A table's paragraph, Markdown; columns in a row that agree in all else are named together."""
    columns: dict[tuple[str, str], list[str]] = {}
    for column, known in table.columns.items():
        about = known.about + ("; not in results of earlier releases" if known.may_be_missing else "")
        columns.setdefault((known.range, about.removeprefix("; ")), []).append(f"`{column}`")
    items = [
        ", ".join(names) + (f" ({held})" if held else "") + (f": {about}" if about else "")
        for (held, about), names in columns.items()
    ]
    text = f"**`{name}`** {table.about} Columns: {'; '.join(items)}."
    return textwrap.fill(text, 150, break_long_words=False, break_on_hyphens=False) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
