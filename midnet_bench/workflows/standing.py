"""The standard test: a detector, fusion or patrol in its place among those that come with the package.

``campaigns/standard.yaml`` is the protocol. The committed results are those of the shipped methods; a run of
other methods by the same protocol has the same seeds, and so the same worlds.
"""

import contextlib
import hashlib
import itertools
import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace
from pathlib import Path

import pandas as pd

from midnet_bench.agents.agent_settings import PATROLS
from midnet_bench.analysis import compare as analysis
from midnet_bench.analysis.compare import MEASURE, Key, joined, series
from midnet_bench.analysis.frames import CONFIGURATION, Results, load_results, records
from midnet_bench.analysis.statistics import Estimate, mean
from midnet_bench.analysis.tables import Cell, Table
from midnet_bench.campaign.definition import Definition
from midnet_bench.campaign.trial import VARIANT, Scalar
from midnet_bench.errors import InputError
from midnet_bench.experiments.experiment import Headline
from midnet_bench.experiments.registry import experiment_of, tables_of
from midnet_bench.io.files import shipped_folder, write_atomically
from midnet_bench.plugins import DETECTORS, FUSIONS
from midnet_bench.workflows.check import detector_ms

PAPER = ("midnet", "paper", "paper")
METHOD = tuple(seam.option for seam in (DETECTORS, FUSIONS, PATROLS))  # the parameters that make a method
SCORE, BESIDE = "f1_one_to_one", "gospa_per_frame_m"  # what methods are sorted by, and what stands beside it
NAME, COSTS, YOURS = "leaderboard", "cost", " (yours)"
LEFT_OUT = ("seeds", "outlier_seed", "p_holm")  # columns that the page does without
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
    common = (definition.parameters.keys() & protocol.parameters.keys()) - {*METHOD}
    return _protocol(definition, common) == _protocol(protocol, common)


def _protocol(definition: Definition, common: Set[str]) -> tuple[object, ...]:
    """What has to agree of two campaigns with ``common`` parameters."""
    others = {factor: values for factor, values in definition.grid.items() if factor not in METHOD}
    return (
        definition.experiment,
        definition.base_seed,
        definition.trials,
        {key: definition.parameters[key] for key in common},
        others,
        definition.variants,
    )


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
    shipped = _scores_of(reference)
    own = _scores_of(results)
    methods = {**own, **shipped}
    methods = {PAPER: methods.pop(PAPER), **methods}  # the baseline stands first
    frame = joined(methods, METHOD)
    record = experiment_of(reference)
    keys = [*METHOD, "seed", MEASURE]
    grouped = series(frame, [*METHOD, "seed", MEASURE, VARIANT])
    by_trial: dict[Key, list[float]] = {}
    for (*key, _), values in grouped.items():
        by_trial.setdefault(tuple(key), []).extend(values.values())
    over_all = pd.DataFrame(
        [(*key, _mean_of(values)) for key, values in by_trial.items()], columns=[*keys, "value"]
    )
    compared = analysis.compare(over_all, METHOD, record.range_of, [SCORE], with_baseline=True)
    by_ground = series(frame, [*METHOD, VARIANT, MEASURE])
    beside = series(over_all, [*METHOD, MEASURE])
    first, grounds = compared[0].contestant, list(dict.fromkeys(frame[VARIANT]))
    rows: list[Mapping[str, Cell]] = []
    for one in compared:
        score = mean(list(one.values.values()), within=record.range_of(SCORE))
        gospa = mean(list(beside[(*one.contestant, BESIDE)].values()), within=record.range_of(BESIDE))
        each = {
            ground: _mean_of(list(by_ground[(*one.contestant, ground, SCORE)].values())) for ground in grounds
        }
        rows.append(
            {
                "method": name_of(one.contestant) + YOURS * (one.contestant not in shipped),
                SCORE: score,
                **analysis.columns_of(one.difference, wants_less=False),
                **({"verdict": "the paper's"} if one.contestant == first else {}),
                **each,
                BESIDE: gospa,
                "cost": costs.get(str(one.contestant[0]), math.nan),
                "digest": digest_of(methods[one.contestant]),
            }
        )
    rows.sort(key=lambda row: -_value(row[SCORE]))
    rows = [{"rank": rank, **row} for rank, row in enumerate(rows, 1)]
    labels = {
        SCORE: "F1 one-to-one",
        BESIDE: "GOSPA, m",
        "cost": "cost, x midnet",
        "difference": "less the paper's",
    }
    hidden = (*grounds, "difference", BESIDE, "cost", "digest", "seeds", "outlier_seed", "p_holm")
    title = f"Standard test, seeds {_seeds(reference)}: mean over {len(grounds)} grounds"
    return Table(NAME, title, rows, {"p_holm": 4, "cost": 1}, labels=labels, beside=hidden)


def _scores_of(results: Results) -> dict[Key, pd.DataFrame]:
    """The scores of each method of a campaign. Raises InputError: a trial is missing."""
    record = experiment_of(results)
    assert record.measures is not None
    definition = results.definition
    if results.finished != definition.cells * definition.trials:
        raise InputError(f"{results.directory}: trials are missing; run the same command again")
    axes = [(name, _values(definition, name)) for name in METHOD]
    found: dict[Key, pd.DataFrame] = {}
    for key in itertools.product(*(values for _, values in axes)):
        part = results
        for (name, _), value in zip(axes, key, strict=True):
            part = part.by_value(name)[str(value)] if name in definition.grid else part
        found[tuple(map(str, key))] = record.measures(part)
    return found


def _values(definition: Definition, name: str) -> Sequence[Scalar]:
    usual = {"detector": "midnet", "fusion": "paper", "patrol": "paper"}[name]
    return definition.grid.get(name) or [definition.parameters.get(name, usual)]


def name_of(method: Key) -> str:
    """``clusters + components(iou=0.02)``: what is not the paper's own; else ``midnet``."""
    detector, fusion, patrol = (str(part).partition("#")[0] for part in method)
    parts = [detector, *([fusion] if fusion != "paper" else []), *([patrol] if patrol != "paper" else [])]
    return " + ".join(parts)


def digest_of(scores: pd.DataFrame) -> str:
    """Hexadecimal digits that only the same scores give, to the last bit."""
    kept = scores.sort_values([VARIANT, "seed", MEASURE], kind="stable")
    text = "\n".join(
        f"{ground} {seed} {measure} {float(value)!r}"
        for ground, seed, measure, value in zip(
            kept[VARIANT], kept["seed"], kept[MEASURE], kept["value"], strict=True
        )
    )
    return hashlib.sha256(text.encode()).hexdigest()[:DIGITS]


def page(table: Table) -> str:
    """``leaderboard.md``."""
    rows = [{name: cell for name, cell in row.items() if name not in LEFT_OUT} for row in table.rows]
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
    write_atomically(results.directory / f"{NAME}.md", page(table))
    table.write(results.directory)
    first, *_ = table.rows
    lines = [f"The best is {first['method']} with {_text(first[SCORE])}."]
    for row in table.rows:
        if str(row["method"]).endswith(YOURS):
            cost = float(str(row["cost"]))
            lines.append(
                f"{row['method']}: rank {row['rank']} of {len(table.rows)} with {_text(row[SCORE])}; beside "
                f"the paper's: {row['verdict']}; digest {row['digest']}"
                + ("." if math.isnan(cost) else f"; a frame costs {cost:.1f} times midnet's.")
            )
    lines += repeated(results)
    notes = [
        "F1 one-to-one counts a second box on an intruder as false; intervals of 95 % over seeds.",
        "Verdicts by Holm at 5 %, seed by seed against the paper's method.",
    ]
    return Headline([table], lines, notes, "docs/leaderboard.md says how to send a row.")


def _stored_costs(directory: Path) -> dict[str, float]:
    path = directory / f"{COSTS}.csv"
    rows = records(pd.read_csv(path)) if path.exists() else []
    return {str(row["detector"]): float(str(row["times_midnet"])) for row in rows}


def repeated(results: Results) -> list[str]:
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


def _mean_of(values: Sequence[float]) -> float:
    kept = [float(value) for value in values if not math.isnan(value)]
    return math.fsum(kept) / len(kept) if kept else math.nan


def _value(cell: Cell) -> float:
    assert isinstance(cell, Estimate)
    return -math.inf if math.isnan(cell.value) else cell.value


def _seeds(results: Results) -> str:
    definition = results.definition
    return f"{definition.base_seed} to {definition.base_seed + definition.trials - 1}"
