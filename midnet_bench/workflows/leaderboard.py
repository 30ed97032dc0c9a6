"""Who is best: the values of some factors of a campaign, ranked, with differences from the first."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pandas as pd

from midnet_bench.analysis.compare import (
    MEASURE,
    BySeed,
    Key,
    columns_of,
    compare,
    holm_notes,
    joined,
    series,
)
from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.analysis.statistics import MEAN_METHOD, Estimate, mean, outlier_notes
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.analysis.words import in_words
from midnet_bench.campaign.provenance import versions_note
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.experiment import Experiment
from midnet_bench.experiments.registry import experiment_of, tables_of
from midnet_bench.io.files import write_atomically
from midnet_bench.rivals.seams import DETECTORS, FUSIONS, PATROLS, PURSUITS

NAMING_CODE = tuple(seam.option for seam in (DETECTORS, FUSIONS, PATROLS, PURSUITS))

Contestant = tuple[str, ...]
"""a value of each factor that is compared"""


def leaderboard(
    directory: str | Path, of: Sequence[str] = (), rank_by: str | None = None, page: str | Path | None = None
) -> list[Table]:
    """A table for each score that ranks, one row for each contestant in each world, the best first.

    A contestant is a value of each compared factor; what else differs between cells is the world. Beside
    its mean stands its difference from the first value of each factor, on the same seeds.

    Args:
        directory: of a campaign.
        of: the factors that are compared; those that name code, such as ``detector``, unless given.
        rank_by: a score of the experiment; those that it names itself unless given.
        page: a Markdown file to write the tables into.

    Raises:
        InputError: the campaign has no such factor, or its experiment no such score.
    """
    results = load_results(directory, tables_of)
    record = experiment_of(results)
    if record.measures is None:
        raise InputError(f"{directory}: the experiment '{record.name}' has no main scores to rank by")
    factors = _compared(results, of)
    frame = joined({who: record.measures(part) for who, part in _parts(results, factors)}, factors)
    measures = list(dict.fromkeys(frame["measure"])) if len(frame) else []
    if rank_by is not None and rank_by not in measures:
        raise InputError(f"{directory}: no score '{rank_by}'{nearest_name(rank_by, measures)}")
    ranked = (
        [measure for measure in record.ranked_by if measure in measures] if rank_by is None else [rank_by]
    )
    tables = [
        _ranking(record, factors, frame, measure, [one for one in measures if one != measure])
        for measure in ranked
    ]
    if page is not None:
        write_atomically(Path(page), _page(results, tables))
    return tables


def _compared(results: Results, of: Sequence[str]) -> list[str]:
    """The factors, in the grid's order."""
    for factor in of:
        if factor not in results.factors:
            nearest = nearest_name(factor, results.factors)
            raise InputError(f"{results.directory}: the grid has no factor '{factor}'{nearest}")
    factors = [factor for factor in results.factors if factor in (of or NAMING_CODE)]
    if not factors:
        raise InputError(
            f"{results.directory}: its grid compares no {', '.join(NAMING_CODE)}; "
            + (
                f"name a factor: --of {' or --of '.join(results.factors)}"
                if results.factors
                else "it has none"
            )
        )
    return factors


def _parts(results: Results, factors: Sequence[str]) -> Iterator[tuple[Contestant, Results]]:
    if not factors:
        yield (), results
        return
    for value, part in results.by_value(factors[0]).items():
        for rest, last in _parts(part, factors[1:]):
            yield (value, *rest), last


def _ranking(
    record: Experiment,
    factors: Sequence[str],
    frame: pd.DataFrame,
    measure: str,
    beside: Sequence[str],
) -> Table:
    """The rows of every world, in the campaign's order of worlds."""
    names = [str(name) for name in frame if name not in (*factors, MEASURE, "seed", "value")]
    frame = _without_repeats(frame, factors, names, measure)
    values = series(frame, [*factors, *names, MEASURE])
    compared = compare(frame, factors, record.range_of, [measure], with_baseline=True)
    worlds = list(dict.fromkeys(one.key for one in compared))
    compared = sorted(compared, key=lambda one: worlds.index(one.key))
    first = compared[0].contestant
    sign = 1.0 if record.wants_less(measure) else -1.0
    rows: list[Mapping[str, Cell]] = []
    for _, world in itertools.groupby(compared, key=lambda one: one.key):
        means = [(_mean(record, measure, one.values), one) for one in world]
        means.sort(key=lambda of: (math.isnan(of[0].value), sign * of[0].value, _texts(of[1].contestant)))
        for rank, (estimate, one) in enumerate(means, 1):
            rows.append(
                {
                    **({"world": one.cell} if len(worlds) > 1 else {}),
                    "rank": rank,
                    **dict(zip(factors, map(_without_pin, _texts(one.contestant)), strict=True)),
                    measure: estimate,
                    **columns_of(one.difference, sign > 0.0),
                    **({"verdict": "the first"} if one.contestant == first else {}),
                    **{
                        score: _mean(record, score, values[key])
                        for score in beside
                        if (key := (*one.contestant, *one.key, score)) in values
                    },
                }
            )
    title = (
        f"Ranked by {in_words(measure)}, {'the lowest' if sign > 0 else 'the highest'} first; "
        f"differences from {' + '.join(map(_without_pin, _texts(first)))} on the same seeds ({MEAN_METHOD}; "
        "verdicts by Holm at 5 %)"
    )
    notes = outlier_notes(one.difference.outlier_seed for one in compared)
    named = [", ".join(filter(None, (" + ".join(_texts(one.contestant)), one.cell))) for one in compared]
    notes += holm_notes(named, [one.difference for one in compared])
    labels = {score: in_words(score) for score in (measure, *beside)}
    others = ("seeds", "p_holm", "outlier_seed", *beside)
    name = f"leaderboard_{measure}"
    return Table(name, title, rows, {"p_holm": 4}, notes=notes, labels=labels, beside=others)


def _without_pin(value: str) -> str:
    """``mine.py:Returns`` for a value that a checksum of the file follows."""
    return value.partition("#")[0]


def _texts(values: Key) -> list[str]:
    return [str(value) for value in values]


def _without_repeats(
    frame: pd.DataFrame, factors: Sequence[str], names: Sequence[str], measure: str
) -> pd.DataFrame:
    """The scores without those of worlds that repeat another one: all cells together, where there is one."""
    values = series(frame[frame[MEASURE] == measure], [*names, *factors])
    worlds: dict[Key, dict[Key, BySeed]] = {}
    for key, by_seed in values.items():
        worlds.setdefault(key[: len(names)], {})[key[len(names) :]] = by_seed
    kept: list[dict[Key, BySeed]] = []
    repeated = set()
    for world, scores in worlds.items():
        if scores in kept:
            repeated.add(world)
        kept.append(scores)
    keys = frame[[*names]].itertuples(index=False, name=None)
    return frame[[tuple(key) not in repeated for key in keys]]


def _mean(record: Experiment, measure: str, values: BySeed) -> Estimate:
    return mean(list(values.values()), within=record.range_of(measure))


def _page(results: Results, tables: Sequence[Table]) -> str:
    definition = results.definition
    last = definition.base_seed + definition.trials - 1
    lines = [
        f"# Leaderboard: {results.directory.name}",
        "",
        f"Experiment `{definition.experiment}`, seeds {definition.base_seed} to {last}, {results.finished} "
        "trials finished. Written by `midnet-bench compare --rank`.",
        *versions_note(results.provenance),
        "",
    ]
    for table in tables:
        lines += [f"## {table.title}", "", table.to_markdown().strip(), ""]
    return "\n".join(lines).rstrip() + "\n"
