"""``report.html``: what a campaign came to, on one page that needs no network."""

import base64
import functools
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from midnet_bench.analysis.statistics import Estimate
from midnet_bench.analysis.tables import Table
from midnet_bench.drawing import palette
from midnet_bench.page.recording import COLUMNS, KINDS, SCAN_COLUMNS, Recording, packed
from midnet_bench.scoring.error_causes import FALSE_CAUSES, MISS_CAUSES

if TYPE_CHECKING:
    from jinja2 import Template

FOLDER = Path(__file__).parent
MOST_BYTES = 9_900_000  # of the page: less than 10 MB
MOST_ROWS = 200  # of a table on the page; its file has them all
LONG_TEXT = 40  # characters of a cell that may take several lines
MOST_SHOWN = 300  # characters of a parameter's value
COLOURS: Mapping[str, tuple[palette.RGB, palette.RGB]] = {
    "paper": (palette.WHITE, (22, 24, 27)),
    "ink": (palette.INK, (232, 230, 225)),
    "soft": ((85, 85, 85), (170, 168, 162)),
    "line": ((221, 221, 221), (54, 57, 62)),
    "edge": (palette.FAINT_INK, (110, 113, 118)),
    "raised": ((243, 243, 240), (36, 39, 43)),
    "link": (palette.GUARD, palette.GUARD_FAINT),
    "on-guard": (palette.WHITE, palette.INK),
    "floor": (palette.FLOOR, (34, 37, 41)),
    "ground": (palette.GROUND, (16, 18, 20)),
    "wood": (palette.WOOD, (124, 100, 72)),
    "faint-ink": (palette.FAINT_INK, (150, 150, 150)),
    "guard": (palette.GUARD, palette.GUARD_FAINT),
    "guard-faint": (palette.GUARD_FAINT, (60, 140, 190)),
    "intruder": (palette.INTRUDER, (240, 130, 50)),
    "intruder-faint": (palette.INTRUDER_FAINT, (112, 66, 34)),
    "guard-range": (palette.GUARD_RANGE, (38, 84, 112)),
    "detection": (palette.DETECTION, (30, 190, 145)),
    "false-detection": (palette.FALSE_DETECTION, (226, 120, 196)),
    "missed": (palette.MISSED, (255, 255, 255)),
}
"""on a light page and on a dark one: each colour keeps its meaning"""
VARIABLES = {  # the same as CSS
    theme: " ".join(f"--{name}: {palette.hexadecimal(pair[index])};" for name, pair in COLOURS.items())
    for index, theme in enumerate(("light", "dark"))
}
CHAPTERS = ["results", "verdicts", "causes", "counterfactuals", "player", "figures", "tables", "provenance"]
"""in their order; the first and the last are always there"""


class Layer(NamedTuple):
    """Something that the player shows or not."""

    name: str
    text: str
    style: str
    is_on: bool


LAYERS = (
    Layer("boxes", "boxes and errors", "color: var(--detection)", True),
    Layer("window", "local costmaps, LiDAR range", "color: var(--guard); border-width: 1px", True),
    Layer("found", "boxes before fusion", "color: var(--faint-ink)", False),
    Layer("truth", "true boxes", "color: var(--intruder)", True),
    Layer("scans", "scans", "color: var(--guard-faint); border-style: dotted", True),
    Layer("believed", "believed poses", "color: var(--ink); border-style: dashed", True),
    Layer("goals", "goals, pursuits", "color: var(--guard); border-width: 2px 0 0", True),
    Layer("names", "numbers and causes", "color: var(--ink); border-width: 0 0 2px", True),
)
LEGEND = (  # words and an SVG of 20 by 20 for each sign, those of the pictures
    (palette.TRUE_POSITIVE, '<rect class="box" x="3" y="3" width="14" height="14"/>'),
    (palette.DUPLICATE, '<rect class="box dashed" x="3" y="3" width="14" height="14"/>'),
    (palette.FALSE_POSITIVE, '<path class="false" d="M3 3h14v14h-14zM3 3l14 14M17 3l-14 14"/>'),
    (
        palette.MISS,
        '<path class="missed" d="M3 10v7h6M11 17h6v-6M17 9v-6h-6"/><circle class="disc" cx="4" cy="4" r="4"/>'
        '<path class="mark" d="M4 1.5v3M4 5.6v1"/>',
    ),
    (palette.NO_ERROR, '<circle class="ring" cx="10" cy="10" r="7"/>'),
)

MISSES, FALSE_BOXES = "misses", "false boxes"
MEANINGS: Mapping[str, Mapping[str, str]] = {MISSES: MISS_CAUSES, FALSE_BOXES: FALSE_CAUSES}
"""a side of the funnel -> cause -> what it means"""
KIND, CAUSE, GUARD, WHO = (COLUMNS["errors"].index(name) for name in ("kind", "cause", "guard", "who"))


class Example(NamedTuple):
    """Where in a recorded trial a cause is seen."""

    trial: int  # place of the trial on the page
    frame: int  # counted from 1
    frames: int  # how long the same error lasts


@dataclass
class Funnel:
    """Where detections are lost: the errors of recorded trials by cause, which :meth:`add` counts."""

    counts: Counter[tuple[str, str, str]] = field(default_factory=Counter)  # (side, cause, cell) -> errors
    examples: dict[tuple[str, str], Example] = field(default_factory=dict)
    """(side, cause) -> where it lasts longest"""
    cells: list[str] = field(default_factory=list)

    def add(self, recording: Recording, trial: int) -> None:
        """Count a trial's errors; ``trial``: its place on the page."""
        if recording.cell not in self.cells:
            self.cells.append(recording.cell)
        frames_of: dict[tuple[str, str, int, int], list[int]] = {}
        for frame, errors in enumerate(recording.frames["errors"], 1):
            for error in errors:
                side = MISSES if KINDS[error[KIND]] == "miss" else FALSE_BOXES
                cause = recording.words[error[CAUSE] - 1]
                self.counts[side, cause, recording.cell] += 1
                frames_of.setdefault((side, cause, error[GUARD], error[WHO]), []).append(frame)
        for (side, cause, _, _), frames in frames_of.items():
            distinct = np.unique(frames)
            runs = np.split(distinct, np.flatnonzero(np.diff(distinct) > 1) + 1)
            longest = max(runs, key=len).tolist()
            known = self.examples.get((side, cause))
            if known is None or len(longest) > known.frames:
                # in its middle the cause is plainest
                example = Example(trial, longest[0] + len(longest) // 2, len(longest))
                self.examples[side, cause] = example

    def total(self, side: str, cell: str, cause: str | None = None) -> int:
        """How many errors a cell has, of a cause if one is given."""
        return sum(
            count
            for (of_side, of_cause, of_cell), count in self.counts.items()
            if (of_side, of_cell) == (side, cell) and cause in (None, of_cause)
        )

    def causes(self, side: str) -> list[str]:
        """Those that occur, the commonest first."""
        totals: Counter[str] = Counter()
        for (of_side, cause, _), count in self.counts.items():
            totals[cause] += count if of_side == side else 0
        return [cause for cause, count in totals.most_common() if count]


class Picture(NamedTuple):
    """A figure of the campaign."""

    name: str
    files: Mapping[str, bytes]  # its content by ending, ``.png`` and ``.svg``
    data: Table


@dataclass(frozen=True)
class Content:
    """What stands on the page, as plain data."""

    title: str
    lead: str
    conclusion: str  # the result in words; empty if there are none
    headline: Sequence[Table]
    verdicts: str  # how many claims of the paper have which verdict; empty if it states nothing of this
    claims: Table | None  # a row for each of them, with a column ``verdict``; None if none is decided
    counterfactuals: Table | None
    tables: Sequence[Table]  # all others
    pictures: Sequence[Picture]
    provenance: Sequence[Mapping[str, Any]]
    configuration: Mapping[str, Any]
    version: str


def report_page(content: Content, recordings: Iterable[Recording], most_bytes: int = MOST_BYTES) -> str:
    """The page as HTML, with the recorded trials that the player plays; each is let go when it is packed.

    Where they do not fit into ``most_bytes``, scans are left out first, those of the trials with the fewest
    errors before the others', then trials.
    """
    funnel = Funnel()
    trials: list[_Packed] = []
    for place, recording in enumerate(recordings):
        funnel.add(recording, place)
        frames, scans = packed(COLUMNS, recording.frames), packed(SCAN_COLUMNS, recording.scans)
        trials.append(_Packed(place, recording.head(), frames, scans))
    empty = [trial._replace(frames="", scans="") for trial in trials]
    fixed = _fixed(content)
    around = len(_rendered(fixed, funnel, empty, set(range(len(trials))), len(trials) + 1).encode())
    kept, with_scans = _fitting(trials, most_bytes - around)
    return _rendered(fixed, funnel, kept, with_scans, len(trials))


class _Packed(NamedTuple):
    place: int  # in the campaign's order
    head: Mapping[str, Any]
    frames: str
    scans: str


def _fitting(trials: Sequence[_Packed], room: int) -> tuple[list[_Packed], set[int]]:
    """The trials that fit into so many bytes, in their order, and the places of those whose scans do too."""
    by_errors = sorted(trials, key=lambda trial: -trial.head["errors"])
    kept, with_scans = set(), set()
    for trial in by_errors:
        if len(trial.frames) <= room:
            room -= len(trial.frames)
            kept.add(trial.place)
    for trial in by_errors:
        if trial.place in kept and len(trial.scans) <= room:
            room -= len(trial.scans)
            with_scans.add(trial.place)
    return [trial for trial in trials if trial.place in kept], with_scans


def _fixed(content: Content) -> dict[str, Any]:
    """What the template takes that no recorded trial changes."""
    from markupsafe import Markup

    pictures = [one for one in content.pictures if {".png", ".svg"} & one.files.keys()]
    some = [*filter(None, (content.claims, content.counterfactuals)), *(one.data for one in pictures)]
    known = {id(table): _shown(table) for table in (*content.headline, *content.tables, *some)}
    figures = [_figure(one, known[id(one.data)]) for one in pictures]
    names = ("page.css", "trial.js", "player.js")
    sources = {name: (FOLDER / name).read_text(encoding="utf-8") for name in names}
    return {
        **vars(content),
        "headline": [known[id(table)] for table in content.headline],
        "claims": known.get(id(content.claims)),
        "counterfactuals": known.get(id(content.counterfactuals)),
        "first_figure": figures[:1],
        "figures": figures[1:],
        "tables": [known[id(table)] for table in content.tables],
        "provenance": [list(_flat(run)) for run in content.provenance],
        "configuration": list(_flat(content.configuration)),
        "colours": {theme: Markup(text) for theme, text in VARIABLES.items()},
        "style": Markup(sources["page.css"]),
        "script": Markup(sources["trial.js"] + sources["player.js"]),
    }


def _rendered(
    fixed: Mapping[str, Any], funnel: Funnel, kept: Sequence[_Packed], with_scans: set[int], recorded: int
) -> str:
    places = {trial.place: number for number, trial in enumerate(kept)}
    page = {
        **fixed,
        "causes": [_side(funnel, side, places) for side in MEANINGS if funnel.causes(side)],
        "player": _player(kept, with_scans, recorded) if kept else None,
    }
    page["chapters"] = [name for name in CHAPTERS if name in ("results", "provenance") or page[name]]
    return _template().render(page=page)


@functools.cache
def _template() -> "Template":
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    return environment.get_template("report.html.j2")


def _player(kept: Sequence[_Packed], with_scans: set[int], recorded: int) -> dict[str, Any]:
    from jinja2.utils import htmlsafe_json_dumps

    data = {f"trial-{number}": trial.frames for number, trial in enumerate(kept)}
    data |= {f"scans-{number}": trial.scans for number, trial in enumerate(kept) if trial.place in with_scans}
    head = {"trials": [trial.head for trial in kept], "columns": COLUMNS, "scanColumns": SCAN_COLUMNS}
    left_out = []
    if len(kept) < recorded:
        fewest = f"{recorded - len(kept)} of {recorded} recorded trials, those with the fewest errors,"
        left_out.append(f"{fewest} are left out")
    if len(with_scans) < len(kept):
        most = f"{len(with_scans)} of {len(kept)} trials have their scans here"
        left_out.append(f"{most}, those with the most errors first")
    return {
        "head": htmlsafe_json_dumps(head, separators=(",", ":")),
        "data": list(data.items()),
        "layers": LAYERS,
        "legend": LEGEND,
        "left_out": f"To keep the page below 10 MB: {'; '.join(left_out)}." if left_out else "",
    }


def _side(funnel: Funnel, side: str, places: Mapping[int, int]) -> dict[str, Any]:
    """One side of the funnel: for each cause its share of each cell's errors, and a link to an example."""
    totals = {cell: funnel.total(side, cell) for cell in funnel.cells}
    causes = []
    for cause in funnel.causes(side):
        example = funnel.examples[side, cause]
        place = places.get(example.trial)
        counts = {cell: funnel.total(side, cell, cause) for cell in funnel.cells}
        causes.append(
            {
                "name": cause.replace("_", " "),
                "meaning": MEANINGS[side].get(cause, ""),
                "link": "" if place is None else f"#trial={place}&frame={example.frame}&cause={cause}",
                "shares": [
                    {"count": count, "percent": f"{100.0 * count / max(1, totals[cell]):.1f}"}
                    for cell, count in counts.items()
                ],
            }
        )
    cells = [{"name": cell, "total": total} for cell, total in totals.items()]
    return {"name": side, "cells": cells, "causes": causes}


def _shown(table: Table) -> dict[str, Any]:
    """A table as the template takes it."""
    texts = {name: any(isinstance(row.get(name), str) for row in table.rows) for name in table.columns}
    rows = [
        {
            "is_paper": "paper" in row.values(),
            "cells": [
                _cell(name, row.get(name), text) for name, text in zip(table.columns, line, strict=True)
            ],
        }
        for row, line in zip(table.rows[:MOST_ROWS], table.cells()[:MOST_ROWS], strict=True)
    ]
    return {
        "name": table.name,
        "title": table.title,
        "columns": [{"name": name.replace("_", " "), "is_text": texts[name]} for name in table.columns],
        "rows": rows,
        "notes": table.notes,
        "left_out": len(table.rows) - len(rows),
        "csv": base64.b64encode(table.to_csv().encode()).decode(),
    }


def _cell(column: str, value: object, text: str) -> dict[str, str]:
    if isinstance(value, Estimate) and (parts := re.fullmatch(r"(\S+) (\[.*\])", text)):
        return {"text": parts[1], "interval": parts[2], "kind": ""}
    kind = "text" if isinstance(value, str) else ""
    if column == "verdict":
        kind += f" verdict {text.replace(' ', '-')}"
    return {"text": text, "interval": "", "kind": f"{kind} long" if len(text) > LONG_TEXT else kind}


def _figure(picture: Picture, data: Mapping[str, Any]) -> dict[str, Any]:
    kinds = {".svg": "image/svg+xml", ".png": "image/png"}  # a browser shows no PDF as a picture
    ending = min(kinds.keys() & picture.files, key=lambda one: len(picture.files[one]))
    image = base64.b64encode(picture.files[ending]).decode()
    labels = [
        list(dict.fromkeys(str(row[column]) for row in picture.data.rows if row.get(column)))
        for column in ("series", "panel")
    ]
    series = ", ".join(labels[0] or labels[1])
    where = f": {series}; its data are below it" if series else "; its data are below"
    return {
        "name": picture.name,
        "source": f"data:{kinds[ending]};base64,{image}",
        "alt": f"Figure {picture.name.replace('_', ' ')}{where}",
        "data": data,
    }


def _flat(values: Mapping[str, Any], before: str = "") -> Iterable[tuple[str, str]]:
    """Names and values, those of what is nested with both names."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            text = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
            yield f"{before}{name}", text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."
