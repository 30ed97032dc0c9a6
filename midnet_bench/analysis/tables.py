"""``Table``: rows for people and for programs, as CSV, Markdown, LaTeX, or on a terminal."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from midnet_bench.campaign.export import csv_text
from midnet_bench.campaign.trial import Row, Scalar
from midnet_bench.io.files import write_atomically

NOT_DEFINED = "n/a"


@dataclass(frozen=True)
class Table:
    """Rows under named columns; a number that is not defined is NaN."""

    title: str
    rows: Sequence[Row]
    digits: dict[str, int] = field(default_factory=dict)
    """digits after the point by column, for every form but CSV; 3 unless given"""

    @property
    def columns(self) -> list[str]:
        """Names in order of first appearance."""
        return list(dict.fromkeys(name for row in self.rows for name in row))

    def cells(self) -> list[list[str]]:
        """The rows as text, ready to print; blank where a row has no such column."""
        return [
            [self._text(name, row[name]) if name in row else "" for name in self.columns] for row in self.rows
        ]

    def to_csv(self) -> str:
        """Every digit of every number; an undefined one is an empty cell."""
        return csv_text(self.rows)

    def to_markdown(self) -> str:
        """A pipe table, numbers to the right."""
        right = {
            name for name in self.columns if not any(isinstance(row.get(name), str) for row in self.rows)
        }
        lines = [self.columns, ["---:" if name in right else "---" for name in self.columns], *self.cells()]
        # a bar in a cell would begin another one
        escaped = [[cell.replace("|", "\\|") for cell in line] for line in lines]
        return "".join(f"| {' | '.join(line)} |\n" for line in escaped)

    def to_latex(self) -> str:
        """A tabular for booktabs."""
        lines = [" & ".join(map(_latex, line)) + r" \\" for line in [self.columns, *self.cells()]]
        body = [lines[0], r"\midrule", *lines[1:]]
        spec = "l" + "r" * (len(self.columns) - 1)
        return "\n".join(
            [rf"\begin{{tabular}}{{{spec}}}", r"\toprule", *body, r"\bottomrule", r"\end{tabular}", ""]
        )

    def write(self, stem: Path) -> list[Path]:
        """Write ``stem``.csv, .md and .tex; their paths."""
        forms = {".csv": self.to_csv(), ".md": self.to_markdown(), ".tex": self.to_latex()}
        for ending, text in forms.items():
            write_atomically(stem.with_suffix(ending), text)
        return [stem.with_suffix(ending) for ending in forms]

    def _text(self, name: str, value: Scalar) -> str:
        if value is None or (isinstance(value, float) and math.isnan(value)):
            return NOT_DEFINED
        return f"{value:.{self.digits.get(name, 3)}f}" if isinstance(value, float) else str(value)


def _latex(text: str) -> str:
    for character in "&%$#_{}":
        text = text.replace(character, "\\" + character)
    return text
