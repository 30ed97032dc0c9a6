"""The standard test: a detector, fusion or patrol in its place among those that come with the package.

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

from midnet_bench.agents.agent_settings import PATROLS
from midnet_bench.analysis import compare as analysis
from midnet_bench.analysis.compare import MEASURE, Key, joined, series
from midnet_bench.analysis.frames import CONFIGURATION, Results, load_results
from midnet_bench.analysis.statistics import Estimate, exact_mean
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.trial import VARIANT, Scalar
from midnet_bench.errors import InputError
from midnet_bench.experiments.registry import Headline, experiment_of, tables_of
from midnet_bench.io.files import shipped_folder, write_atomically
from midnet_bench.plugins import DETECTORS, FUSIONS
from midnet_bench.workflows.check import detector_ms
from midnet_bench.workflows.compare import HIDDEN, ranked, seed_mean

METHOD = {DETECTORS.option: "midnet", FUSIONS.option: "paper", PATROLS.option: "paper"}
"""parameter that is part of a method -> the paper's own"""
PAPER = tuple(METHOD.values())
SCORE, BESIDE = "f1_one_to_one", "gospa_per_frame_m"  # what methods are sorted by, and what stands beside it
NAME, COSTS, YOURS = "leaderboard", "cost", " (yours)"
DIGITS = 8  # of a row's digest


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


def costs_of(results: Results) -> Table:
    """A row for each detector of a campaign: how long a frame of four robots takes it, beside the paper's.

    Times differ from run to run and are in no other table.
    """
    paper_ms = detector_ms(PAPER[0])
    rows: list[Mapping[str, Cell]] = [
        {"detector": str(name), "frame_ms": ms, "times_midnet": ms / paper_ms}
        for name in _values(results.definition, "detector")
        for ms in [detector_ms(str(name))]
    ]
    return Table(COSTS, "Cost of a frame of four robots", rows)


def standing(results: Results, costs: Mapping[str, float]) -> Table:
    """The methods of a campaign among the shipped ones, the best first.

    Args:
        results: of a campaign that :func:`is_standard`, the committed one or another.
        costs: detector -> time of a frame as a multiple of the paper's.

    Returns:
        A row for each method: its mean one-to-one F1 over the grounds, the difference from the paper's
        method on the same seeds with its verdict, the score on each ground, GOSPA, and a digest of all its
        scores.

    Raises:
        InputError: trials are missing.
    """
    reference = load_results(reference_folder(), tables_of)
    record, shipped = experiment_of(reference), _scores_of(reference)
    methods = {**_scores_of(results), **shipped}
    methods = {PAPER: methods.pop(PAPER), **methods}  # the baseline stands first
    frame = joined(methods, [*METHOD])
    grounds = list(dict.fromkeys(frame[VARIANT]))
    on_ground = series(frame, [*METHOD, MEASURE, VARIANT])
    keys = [*METHOD, "seed", MEASURE]
    over_all = frame.groupby(keys, sort=False, dropna=False)["value"].agg(_mean_of).reset_index()
    compared = analysis.compare(over_all, [*METHOD], record.range_of, [SCORE], with_baseline=True)
    beside = series(over_all, [*METHOD, MEASURE])
    rows: list[Mapping[str, Cell]] = [
        {
            "rank": place,
            "method": name_of(one.contestant) + YOURS * (one.contestant not in shipped),
            **score,
            **{ground: _mean_of(on_ground[*one.contestant, SCORE, ground].values()) for ground in grounds},
            BESIDE: seed_mean(record, BESIDE, beside[*one.contestant, BESIDE]),
            "cost": costs.get(str(one.contestant[0]), math.nan),
            "digest": digest_of(methods[one.contestant]),
        }
        for place, (one, score) in enumerate(ranked(record, compared, "the paper's"), 1)
    ]
    labels = {SCORE: "F1 one-to-one", BESIDE: "GOSPA, m", "cost": "cost, x midnet"}
    labels |= {"difference": "less the paper's"}
    hidden = (*grounds, "difference", BESIDE, "cost", "digest", "seeds", "outlier_seed", "p_holm")
    seeds = reference.definition
    title = (
        f"Standard test, seeds {seeds.base_seed} to {seeds.base_seed + seeds.trials - 1}: "
        f"mean over {len(grounds)} grounds"
    )
    return Table(NAME, title, rows, {"p_holm": 4, "cost": 1}, labels=labels, beside=hidden)


def _scores_of(results: Results) -> dict[Key, pd.DataFrame]:
    """The scores of each method of a campaign. Raises InputError: a trial is missing."""
    record = experiment_of(results)
    assert record.report.measures is not None
    definition = results.definition
    if results.finished != definition.cells * definition.trials:
        raise InputError(f"{results.directory}: trials are missing; run the same command again")
    found: dict[Key, pd.DataFrame] = {}
    for key in itertools.product(*(_values(definition, name) for name in METHOD)):
        part = results
        for name, value in zip(METHOD, key, strict=True):
            part = part.by_value(name)[str(value)] if name in definition.grid else part
        found[tuple(map(str, key))] = record.report.measures(part)
    return found


def _values(definition: Definition, name: str) -> Sequence[Scalar]:
    return definition.grid.get(name) or [definition.parameters.get(name, METHOD[name])]


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


def page(table: Table) -> str:
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


def headline(results: Results) -> Headline:
    """What a terminal shows of a campaign that :func:`is_standard`; also writes ``leaderboard.md``."""
    own = _stored_costs(results.directory)
    if not set(map(str, _values(results.definition, "detector"))) <= own.keys():
        with contextlib.suppress(InputError):  # a report does not have the code that the run had
            costs_of(results).write(results.directory)
        own = _stored_costs(results.directory)
    table = standing(results, {**_stored_costs(reference_folder()), **own})
    table.write(results.directory)
    write_atomically(results.directory / f"{NAME}.md", page(table))  # in the place of the bare table
    lines = [f"The best is {table.rows[0]['method']} with {_text(table.rows[0][SCORE])}."]
    for row in table.rows:
        if str(row["method"]).endswith(YOURS):
            cost = float(str(row["cost"]))
            lines.append(
                f"{row['method']}: rank {row['rank']} of {len(table.rows)} with {_text(row[SCORE])}; beside "
                f"the paper's: {row['verdict']}; digest {row['digest']}"
                + ("." if math.isnan(cost) else f"; a frame costs {cost:.1f} times midnet's.")
            )
    notes = [
        "F1 one-to-one counts a second box on an intruder as false; intervals of 95 % over seeds.",
        "Verdicts by Holm at 5 %, seed by seed against the paper's method.",
    ]
    return Headline([table], lines + _repeated(results), notes, "docs/leaderboard.md says how to send a row.")


def _stored_costs(directory: Path) -> dict[str, float]:
    path = directory / f"{COSTS}.csv"
    if not path.exists():
        return {}
    costs = pd.read_csv(path)
    return {
        str(name): float(times) for name, times in zip(costs["detector"], costs["times_midnet"], strict=True)
    }


def _repeated(results: Results) -> list[str]:
    """A line for each shipped method that a campaign ran again: whether every score is the committed one."""
    if results.directory.resolve() == reference_folder().resolve():
        return []
    shipped = _scores_of(load_results(reference_folder(), tables_of))
    return [
        f"{name_of(method)}: every score is the committed one, to the last bit."
        if digest_of(scores) == digest_of(shipped[method])
        else f"{name_of(method)}: scores differ from the committed ones; is this another version?"
        for method, scores in _scores_of(results).items()
        if method in shipped
    ]


def _text(cell: Cell) -> str:
    assert isinstance(cell, Estimate)
    return f"{cell.value:.3f} [{cell.low:.3f}, {cell.high:.3f}]"


def _mean_of(values: Iterable[float]) -> float:
    kept = [float(value) for value in values if not math.isnan(value)]
    return exact_mean(kept) if kept else math.nan
