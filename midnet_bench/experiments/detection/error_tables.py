"""Tables of recorded errors: how often each cause is, and whether errors go when it is taken away."""

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from midnet_bench.analysis import statistics
from midnet_bench.analysis.frames import Results
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.geometry import Box
from midnet_bench.scoring.error_causes import FALSE_CAUSES, MISS_CAUSES, REMOVED_BY, UNEXPLAINED

CAUSES, COUNTERFACTUALS = "error_causes", "counterfactuals"
KINDS = {"miss": MISS_CAUSES, "false": FALSE_CAUSES, "fragment": FALSE_CAUSES}
ORACLE, NONE = "oracle", "none"


def error_tables(results: Results) -> list[Table]:
    """The causes and, where trials differ in ``oracle``, the counterfactuals; nothing if not recorded."""
    errors = results.tables.get("errors")
    if errors is None or errors.empty:
        return []
    tables = [causes_table(results, errors)]
    if ORACLE in results.factors and NONE in results.definition.grid[ORACLE]:
        tables.append(counterfactuals_table(results, errors))
    return tables


def causes_table(results: Results, errors: pd.DataFrame) -> Table:
    """A row for each cell, kind and cause: how many, their share of the kind's errors, and of the paper's."""
    errors = errors.assign(cell=results.teams(errors))
    seeds = _seeds(results)
    rows: list[Mapping[str, Cell]] = []
    notes = []
    for cell, own in errors.groupby("cell", sort=False):
        for kind, known in KINDS.items():
            part = own[own["kind"] == kind]
            all_of = part.groupby("seed").size().to_dict()
            counts = part["cause"].value_counts()
            for cause in sorted(counts.index, key=lambda name: (-counts[name], list(known).index(name))):
                of_cause = part[part["cause"] == cause]
                by_seed = of_cause.groupby("seed").size().to_dict()
                shares = [by_seed.get(seed, 0) / all_of[seed] for seed in seeds if all_of.get(seed)]
                rows.append(
                    {
                        "trial": str(cell),
                        "kind": kind,
                        "cause": str(cause),
                        "errors": len(of_cause),
                        "share": len(of_cause) / len(part),
                        "mean_share": statistics.mean(shares, within=(0.0, 1.0)),
                        "paper_errors": int(of_cause["paper"].sum()),
                        "meaning": known[str(cause)],
                    }
                )
        unexplained = int((own["cause"] == UNEXPLAINED).sum())
        notes.append(f"{cell}: {unexplained} of {len(own)} errors ({unexplained / len(own):.1%}) unexplained")
    title = f"Causes of errors, by one-to-one matching ({statistics.MEAN_METHOD}, over seeds)"
    digits = {"share": 3, "mean_share": 3}
    return Table(CAUSES, title, rows, digits, notes=notes, beside=("meaning", "paper_errors", "mean_share"))


class Error(NamedTuple):
    """What of one error tells whether another trial has it too."""

    kind: str
    cause: str
    intruder: str
    box: Box


def counterfactuals_table(results: Results, errors: pd.DataFrame) -> Table:
    """A row for each team, oracle and cause that the oracle takes away: which errors are gone, and which new.

    Trials of one seed that differ in ``oracle`` are the same scene, frame by frame. A miss is gone if its
    intruder has a box of its own in that frame; another error if no such box has any area in common with it.
    """
    errors = errors.assign(cell=results.teams(errors, ORACLE))
    grouped = {key: by_frame(part) for key, part in errors.groupby(["cell", ORACLE], sort=False)}
    rows: list[Mapping[str, Cell]] = []
    teams = list(dict.fromkeys(errors["cell"]))
    for team in teams:
        base = grouped.get((team, NONE), {})
        total = sum(map(len, base.values()))
        for oracle in results.definition.grid[ORACLE]:
            if oracle == NONE or not base:
                continue
            changed = grouped.get((team, oracle), {})
            gone = {place: without(found, changed.get(place, ())) for place, found in base.items()}
            new = sum(len(without(found, base.get(place, ()))) for place, found in changed.items())
            causes = REMOVED_BY.get(str(oracle), ())
            for cause in (*causes, "all errors"):
                chosen = [e for found in base.values() for e in found if cause in (e.cause, "all errors")]
                removed = [e for found in gone.values() for e in found if cause in (e.cause, "all errors")]
                row: dict[str, Cell] = {
                    "trial": team,
                    "oracle": str(oracle),
                    "cause": cause,
                    "errors": len(chosen),
                    "attributed_share": len(chosen) / total if total else None,
                    "removed": len(removed),
                    "removed_share": len(removed) / len(chosen) if chosen else None,
                }
                rows.append({**row, "new_errors": new} if cause == "all errors" else row)
    title = "Counterfactuals: the same scenes, with one cause of errors taken away"
    digits = {"attributed_share": 3, "removed_share": 3}
    return Table(COUNTERFACTUALS, title, rows, digits, beside=("new_errors", "attributed_share"))


def by_frame(errors: pd.DataFrame) -> dict[tuple[int, int], list[Error]]:
    """(seed, frame) -> the errors of a table ``errors`` there; trials of one cell."""
    columns = (errors[name].tolist() for name in ("seed", "frame", "kind", "cause", "intruder"))
    boxes = errors[["x_min_m", "y_min_m", "x_max_m", "y_max_m"]].to_numpy().tolist()
    found: dict[tuple[int, int], list[Error]] = {}
    for seed, frame, kind, cause, intruder, box in zip(*columns, boxes, strict=True):
        found.setdefault((seed, frame), []).append(Error(kind, cause, intruder, Box(*box)))
    return found


def without(errors: Iterable[Error], others: Sequence[Error]) -> list[Error]:
    """Those of ``errors`` that are not among ``others``, errors of the same frame."""
    return [one for one in errors if not any(_is_same(one, other) for other in others)]


def _is_same(one: Error, other: Error) -> bool:
    if one.kind != other.kind:
        return False
    if one.kind == "miss":
        return one.intruder == other.intruder
    return one.box.intersection_area(other.box) > 0.0


def _seeds(results: Results) -> list[int]:
    definition = results.definition
    return list(range(definition.base_seed, definition.base_seed + definition.trials))
