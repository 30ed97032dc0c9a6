"""Ranks: what a campaign compares, the best first, and the standard test: a method among those shipped.

``campaigns/standard.yaml`` is the protocol. The committed results are those of the shipped methods; a run of
other methods by the same protocol has the same seeds, and so the same worlds.
"""

import contextlib
import hashlib
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd

from midnet_bench.agents.agent_settings import PATROLS, PURSUITS
from midnet_bench.analysis.compare import (
    MEASURE,
    BySeed,
    Compared,
    Key,
    cell_columns,
    joined,
    notes_on,
    paired,
    series,
)
from midnet_bench.analysis.frames import CONFIGURATION, Results, load_results
from midnet_bench.analysis.statistics import Estimate, exact_mean
from midnet_bench.analysis.tables import Cell, Table, in_words
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.provenance import versions_note
from midnet_bench.campaign.trial import VARIANT
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments.registry import Experiment, Headline, experiment_of, tables_of
from midnet_bench.io.files import shipped_folder, write_atomically
from midnet_bench.plugins import DETECTORS, FUSIONS
from midnet_bench.workflows.check import detector_ms
from midnet_bench.workflows.compare import HIDDEN, HOW, scores_of, seed_mean

NAMING_CODE = tuple(point.option for point in (DETECTORS, FUSIONS, PATROLS, PURSUITS))
"""factors that are ranked unless others are given"""
METHOD = {DETECTORS.option: "midnet", FUSIONS.option: "paper", PATROLS.option: "paper"}
"""parameter that is part of a method -> the paper's own"""
PAPER = tuple(METHOD.values())
SCORE, BESIDE = "f1_one_to_one", "gospa_per_frame_m"  # what methods are sorted by, and what stands beside it
NAME, COSTS, YOURS = "leaderboard", "cost", " (yours)"
DIGITS = 8  # of a row's digest


def rank(directory: str | Path, of: Sequence[str] = (), rank_by: str | None = None) -> list[Table]:
    """A table for each score that ranks, one row for each contestant in each world, the best first.

    A contestant is a value of each compared factor; what else differs between cells is the world. Beside
    its mean is its difference from the first value of each factor, on the same seeds. Of a campaign that
    keeps to the standard test it is the :func:`standard_table`, unless a factor or a score is given.

    Args:
        directory: of a campaign.
        of: the factors that are compared; those that name code, such as ``detector``, unless given.
        rank_by: a score of the experiment; those that it names itself unless given, else all.

    Raises:
        InputError: the campaign has no such factor or no finished trial, or its experiment no such score.
    """
    results = load_results(directory, tables_of)
    if not of and rank_by is None and is_standard(results.definition):
        return [standard_table(results)]
    record = experiment_of(results)
    if record.report.measures is None:
        raise InputError(f"{directory}: the experiment '{record.name}' has no main scores to rank by")
    known = results.factors
    factors = [factor for factor in known if factor in (of or NAMING_CODE)]
    if not factors and not of:
        hint = f"name a factor: --of {' or --of '.join(known)}" if known else "it has none"
        raise InputError(f"{results.directory}: its grid compares no {', '.join(NAMING_CODE)}; {hint}")
    if unknown := [name for name in of if name not in known]:
        results.by_value(unknown[0])  # refuses it
    parts = contestants(results, factors)
    frame = scores_of(record, parts, factors)
    measures = list(dict.fromkeys(frame[MEASURE])) if len(frame) else []
    if not measures:
        raise InputError(f"{directory}: no trial has finished: there is nothing to rank")
    if rank_by is not None and rank_by not in measures:
        raise InputError(f"{directory}: no score '{rank_by}'{nearest_name(rank_by, measures)}")
    named = [measure for measure in record.report.ranked_by if measure in measures]
    chosen = [rank_by] if rank_by else named or measures
    return [
        _ranking(record, factors, frame, one, [other for other in measures if other != one]) for one in chosen
    ]


def _ranking(
    record: Experiment, factors: Sequence[str], frame: pd.DataFrame, measure: str, beside: Sequence[str]
) -> Table:
    """The rows of every world, in the campaign's order of worlds."""
    frame = _without_repeats(frame, factors, cell_columns(frame, factors), measure)
    compared, rows = _rows(record, factors, frame, measure, beside, "the first")
    first = compared[0].contestant
    best = "the lowest" if record.wants_less(measure) else "the highest"
    title = (
        f"Ranked by {in_words(measure)}, {best} first; "
        f"differences from {' + '.join(_texts(first, with_pin=False))} {HOW}"
    )
    labels = {score: in_words(score) for score in (measure, *beside)}
    called = [", ".join(filter(None, (" + ".join(_texts(one.contestant)), one.cell))) for one in compared]
    return Table(
        f"{NAME}_{measure}",
        title,
        [row for _, row in rows],
        {"p_holm": 4},
        notes=notes_on(compared, called),
        labels=labels,
        beside=(*HIDDEN, *beside),
    )


def _rows(
    record: Experiment,
    factors: Sequence[str],
    frame: pd.DataFrame,
    measure: str,
    beside: Sequence[str],
    baseline: str,
) -> tuple[list[Compared], list[tuple[Key, dict[str, Cell]]]]:
    """The differences of a score, world by world, and each contestant with its row, the best first.

    A row has its place, its factors' values, the score, the difference from the frame's first contestant,
    whose verdict is ``baseline``, and the scores ``beside``.
    """
    values = series(frame, [*factors, *cell_columns(frame, factors), MEASURE])
    compared = paired(frame, factors, record.range_of, record.wants_less, [measure], with_baseline=True)
    first, worlds = compared[0].contestant, list(dict.fromkeys(one.key for one in compared))
    compared.sort(key=lambda one: worlds.index(one.key))
    sign = 1.0 if record.wants_less(measure) else -1.0
    rows = []
    for key, world in itertools.groupby(compared, key=lambda one: one.key):
        means = [(seed_mean(record, measure, one.values), one) for one in world]
        means.sort(key=lambda of: (math.isnan(of[0].value), sign * of[0].value, _texts(of[1].contestant)))
        for place, (score, one) in enumerate(means, 1):
            row: dict[str, Cell] = {"world": one.cell} if len(worlds) > 1 else {}
            row |= {"rank": place, **dict(zip(factors, _texts(one.contestant, with_pin=False), strict=True))}
            row |= {measure: score, **one.columns}
            row |= {"verdict": baseline} if one.contestant == first else {}
            for other in beside:
                if (seeds := values.get((*one.contestant, *key, other))) is not None:
                    row[other] = seed_mean(record, other, seeds)
            rows.append((one.contestant, row))
    return compared, rows


def contestants(results: Results, factors: Sequence[str]) -> dict[Key, Results]:
    """The parts of a campaign by the values of factors; of a part of a method, also where it has one value.

    Raises InputError: an unknown factor.
    """
    parts: dict[Key, Results] = {(): results}
    for factor in factors:
        if factor in METHOD and factor not in results.factors:
            value = str(results.definition.parameters.get(factor, METHOD[factor]))
            parts = {(*key, value): part for key, part in parts.items()}
            continue
        each = [(key, part.by_value(factor)) for key, part in parts.items()]
        parts = {(*key, name): part for key, own in each for name, part in own.items()}
    return parts


def _texts(values: Key, with_pin: bool = True) -> list[str]:
    """The values of factors; without the checksum that follows the name of a user's file if so."""
    return [str(value) if with_pin else str(value).partition("#")[0] for value in values]


def _without_repeats(
    frame: pd.DataFrame, factors: Sequence[str], names: Sequence[str], measure: str
) -> pd.DataFrame:
    """The scores without those of worlds that repeat another one: all cells together, where there is one."""
    worlds: dict[Key, dict[Key, BySeed]] = {}
    for key, by_seed in series(frame[frame[MEASURE] == measure], [*names, *factors]).items():
        worlds.setdefault(key[: len(names)], {})[key[len(names) :]] = by_seed
    scores = [*worlds.values()]
    repeated = {world for i, world in enumerate(worlds) if scores[i] in scores[:i]}
    keys = frame[[*names]].itertuples(index=False, name=None)
    return frame[[key not in repeated for key in keys]]


def write_ranking(directory: str | Path, tables: Sequence[Table], page: Path) -> None:
    """Write the tables of :func:`rank` into a Markdown file."""
    if tables[0].name == NAME:
        write_atomically(page, standard_page(tables[0]))
        return
    results = load_results(directory, tables_of)
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
    write_atomically(page, "\n".join(lines).rstrip() + "\n")


def reference_folder() -> Path:
    """The committed results of the shipped methods."""
    return shipped_folder("reference/standard", "results/reference/standard")


def is_standard(definition: Definition) -> bool:
    """Whether a campaign keeps to the protocol: all but the methods is that of the committed results."""
    try:
        protocol = Definition.from_json((reference_folder() / CONFIGURATION).read_text(encoding="utf-8"))
    except OSError:
        return False
    # a parameter that only one of both knows came later, or is fixed by now: at its default either way
    common = (definition.parameters.keys() & protocol.parameters.keys()) - METHOD.keys()
    ours, theirs = (
        replace(
            one,
            grid={factor: values for factor, values in one.grid.items() if factor not in METHOD},
            parameters={key: one.parameters[key] for key in common},
            compare=None,
        )
        for one in (definition, protocol)
    )
    return ours == theirs


def standard_table(results: Results) -> Table:
    """The methods of a campaign among the shipped ones, the best first; writes ``cost.csv`` if it lacks.

    Args:
        results: of a campaign that :func:`is_standard`, the committed one or another.

    Returns:
        A row for each method: its mean one-to-one F1 over the grounds, the difference from the paper's
        method on the same seeds with its verdict, the score on each ground, GOSPA, the cost of a frame, and
        a digest of all its scores.

    Raises:
        InputError: trials are missing.
    """
    reference = load_results(reference_folder(), tables_of)
    record, shipped = experiment_of(reference), _scores_of_methods(reference)
    methods = {**_scores_of_methods(results), **shipped}
    methods = {PAPER: methods.pop(PAPER), **methods}  # the baseline stands first
    frame, costs = joined(methods, [*METHOD]), _costs(results)
    grounds = list(dict.fromkeys(frame[VARIANT]))
    on_ground = series(frame, [*METHOD, MEASURE, VARIANT])
    keys = [*METHOD, "seed", MEASURE]
    over_all = frame.groupby(keys, sort=False, dropna=False)["value"].agg(_mean_of).reset_index()
    _, placed = _rows(record, [*METHOD], over_all, SCORE, [BESIDE], "the paper's")
    rows: list[Mapping[str, Cell]] = [
        {
            "rank": row["rank"],
            "method": name_of(method) + YOURS * (method not in shipped),
            **{name: cell for name, cell in row.items() if name not in ("rank", *METHOD, BESIDE)},
            **{ground: _mean_of(on_ground[*method, SCORE, ground].values()) for ground in grounds},
            BESIDE: row[BESIDE],
            COSTS: costs.get(str(method[0]), math.nan),
            "digest": digest_of(methods[method]),
        }
        for method, row in placed
    ]
    labels = {SCORE: "F1 one-to-one", BESIDE: "GOSPA, m", COSTS: "cost, x midnet"}
    labels |= {"difference": "less the paper's"}
    hidden = (*grounds, "difference", BESIDE, COSTS, "digest", "seeds", "outlier_seed", "p_holm")
    seeds = reference.definition
    title = (
        f"Standard test, seeds {seeds.base_seed} to {seeds.base_seed + seeds.trials - 1}: "
        f"mean over {len(grounds)} grounds"
    )
    return Table(NAME, title, rows, {"p_holm": 4, COSTS: 1}, labels=labels, beside=hidden)


def _scores_of_methods(results: Results) -> dict[Key, pd.DataFrame]:
    """The scores of each method of a campaign. Raises InputError: a trial is missing."""
    measures, definition = experiment_of(results).report.measures, results.definition
    assert measures is not None
    if results.finished != definition.cells * definition.trials:
        raise InputError(f"{results.directory}: trials are missing; run the same command again")
    return {method: measures(part) for method, part in contestants(results, [*METHOD]).items()}


def name_of(method: Key) -> str:
    """``clusters + components(iou=0.02)``: what is not the paper's own; else ``midnet``."""
    detector, *others = (str(part).partition("#")[0] for part in method)
    return " + ".join([detector, *(part for part in others if part != "paper")])


def digest_of(scores: pd.DataFrame) -> str:
    """Hexadecimal digits that only the same scores give, to the last bit."""
    kept = scores.sort_values([VARIANT, "seed", MEASURE], kind="stable")
    rows = kept[[VARIANT, "seed", MEASURE, "value"]].itertuples(index=False, name=None)
    text = "\n".join(f"{ground} {seed} {measure} {float(value)!r}" for ground, seed, measure, value in rows)
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def standard_page(table: Table) -> str:
    """``leaderboard.md``."""
    rows = [{name: cell for name, cell in row.items() if name not in HIDDEN} for row in table.rows]
    return f"""# Leaderboard

Five guards in Map 1, in an office, among people who walk, and among people who stand still:
`campaigns/standard.yaml`, version 1. The score is the mean one-to-one F1 over the four. Its difference is
from the paper's method on the same seeds, with a verdict by Holm at 5 %. A row is a detector, with the fusion
and the patrol where they are not the paper's.

    midnet-bench run standard --detector mine.py:Mine
    midnet-bench run standard --detector subtraction --fusion "components(iou=0.02)"

The first prints yours in its place; `--fusion` and `--patrol` do so for theirs. The second makes a row again
and says whether every score is the committed one, to the last bit. To send a row, open a pull request with
the file, the command and the digest. `make leaderboard` makes this page.

{replace(table, rows=rows).to_markdown().strip()}
"""


def _costs(results: Results) -> dict[str, float]:
    """Detector -> time of a frame of four robots as a multiple of the paper's; shipped ones and own ones.

    Times differ from run to run. They are in no table but ``cost.csv``, for which the own are measured once.
    """
    folders = (reference_folder(), results.directory)
    own = [str(name) for (name,) in contestants(results, [DETECTORS.option])]
    if not {*own} <= _stored_costs(results.directory).keys():
        with contextlib.suppress(InputError):  # a report does not have the code that the run had
            paper_ms, times_ms = detector_ms(PAPER[0]), {name: detector_ms(name) for name in own}
            rows: list[Mapping[str, Cell]] = [
                {"detector": name, "frame_ms": ms, "times_midnet": ms / paper_ms}
                for name, ms in times_ms.items()
            ]
            Table(COSTS, "Cost of a frame of four robots", rows).write(results.directory)
    return {name: times for folder in folders for name, times in _stored_costs(folder).items()}


def _stored_costs(directory: Path) -> dict[str, float]:
    path = directory / f"{COSTS}.csv"
    costs = pd.read_csv(path) if path.exists() else pd.DataFrame({"detector": [], "times_midnet": []})
    return dict(zip(costs["detector"], costs["times_midnet"], strict=True))


def standard_headline(results: Results) -> Headline:
    """What a terminal shows of a campaign that :func:`is_standard`; also writes ``leaderboard.md``."""
    table = standard_table(results)
    table.write(results.directory)
    write_atomically(results.directory / f"{NAME}.md", standard_page(table))  # in the place of the bare table
    lines = [f"The best is {table.rows[0]['method']} with {_text(table.rows[0][SCORE])}."]
    for row in table.rows:
        if str(row["method"]).endswith(YOURS):
            cost = float(str(row[COSTS]))
            lines.append(
                f"{row['method']}: rank {row['rank']} of {len(table.rows)} with {_text(row[SCORE])}; beside "
                f"the paper's: {row['verdict']}; digest {row['digest']}"
                + ("." if math.isnan(cost) else f"; a frame costs {cost:.1f} times midnet's.")
            )
    notes = [
        "F1 one-to-one counts a second box on an intruder as false; intervals of 95 % over seeds.",
        "Verdicts by Holm at 5 %, seed by seed against the paper's method.",
    ]
    lines += _repeated(results, {str(row["method"]): str(row["digest"]) for row in table.rows})
    return Headline([table], lines, notes, "docs/leaderboard.md says how to send a row.")


def _repeated(results: Results, digests: Mapping[str, str]) -> list[str]:
    """A line for each shipped method that a campaign ran again: whether every score is the committed one.

    ``digests``: of the committed scores, by the method's name.
    """
    if results.directory.resolve() == reference_folder().resolve():
        return []
    return [
        f"{name}: every score is the committed one, to the last bit."
        if digest_of(scores) == digests[name]
        else f"{name}: scores differ from the committed ones; is this another version?"
        for method, scores in _scores_of_methods(results).items()
        if (name := name_of(method)) in digests
    ]


def _text(cell: Cell) -> str:
    assert isinstance(cell, Estimate)
    return f"{cell.value:.3f} [{cell.low:.3f}, {cell.high:.3f}]"


def _mean_of(values: Iterable[float]) -> float:
    kept = [float(value) for value in values if not math.isnan(value)]
    return exact_mean(kept) if kept else math.nan
