"""Writes the columns of the trials' tables into ``docs/results.md`` from their declarations: ``make api``."""

import re
import textwrap
from itertools import chain
from pathlib import Path

from midnet_bench.campaign.columns import Columns
from midnet_bench.campaign.export import TIMING_TABLE
from midnet_bench.experiments.columns import DETECTION, LABYRINTH, MAPPING

PAGE = Path(__file__).with_name("results.md")
BLOCK = re.compile(r"^\*\*`(\w+)`\*\* (?:(?!\n\n).)*\n\n\| column .*?\n(?=\n)", re.M | re.S)
"""a table's sentence and its columns; other tables of the page have a paragraph"""
TABLES = dict(chain(TIMING_TABLE.items(), MAPPING.items(), LABYRINTH.items(), DETECTION.items()))


def page(text: str) -> str:
    """The page, whose blocks are made anew. Raises KeyError: a block of an unknown table."""
    return BLOCK.sub(lambda found: block(found[1], TABLES[found[1]]), text)


def block(name: str, table: Columns) -> str:
    """A table's sentence and its columns, Markdown; columns in a row that agree in all else share a line."""
    lines: dict[tuple[str, str], list[str]] = {}
    for column, known in table.columns.items():
        lines.setdefault((known.range, known.about), []).append(f"`{column}`")
    rows = [f"| {', '.join(names)} | {held} | {about} |" for (held, about), names in lines.items()]
    about = textwrap.fill(f"**`{name}`** {table.about}", 150, break_long_words=False)
    return "\n".join([about, "", "| column | unit, values | meaning |", "| --- | --- | --- |", *rows, ""])


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
