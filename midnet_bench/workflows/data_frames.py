"""Campaigns from a notebook: run one, and compare, verify and explain what is there, as data frames."""

import hashlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from midnet_bench.analysis.frames import Results, load_results
from midnet_bench.analysis.tables import Table
from midnet_bench.campaign.definition import Campaign, Definition, Values, parse_campaign, resolve
from midnet_bench.campaign.trial import Tables
from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.experiments import registry
from midnet_bench.workflows import compare as comparison
from midnet_bench.workflows import errors as causes
from midnet_bench.workflows import verify as claims
from midnet_bench.workflows.campaigns import run_campaign

Folder = str | Path | Results  # a campaign's folder, or its results
Plugin = Callable[..., Any]


def run(
    campaign: str | Campaign = "detection",
    output: str | Path | None = None,
    *,
    seed: int = 1,
    seeds: int = 1,
    jobs: int | None = None,
    **parameters: "Values | Plugin | list[Plugin]",
) -> Results:
    """Run a campaign and give its results; the same call again runs only what is missing.

    Args:
        campaign: an experiment, such as ``"detection"``, or a ``Campaign``.
        output: the folder; unless given, one below ``results`` whose name holds a digest of the campaign.
        seed: the first one; of an experiment.
        seeds: how many trials each cell has; of an experiment.
        jobs: worker processes, all of this machine's cores unless given.
        parameters: of an experiment, those that are not to have their default; a list of values makes a
            factor. A plug-in may be a class or a function: ``run(detector=Mine, robots=[1, 5])``.

    Raises:
        InputError: the campaign, a parameter or the folder is no good; the message says which and why.
        MidnetBenchError: all trials failed; the message has the first reason.
    """
    if isinstance(campaign, str):
        factors = {key: value for key, value in parameters.items() if isinstance(value, list)}
        values = {
            "experiment": campaign,
            "name": campaign.rpartition(":")[2],
            "grid": factors,
            "parameters": {key: value for key, value in parameters.items() if key not in factors},
            "trials": seeds,
            "base_seed": seed,
        }
        campaign = parse_campaign(values, "run")
    elif parameters:
        raise InputError("run: a Campaign has its parameters; give none beside it")
    if output is None:
        text = resolve(campaign, registry).definition.to_json().encode()
        output = Path("results", f"{campaign.name}-{hashlib.sha256(text).hexdigest()[:8]}")
    outcome = run_campaign(campaign, output, jobs=jobs)
    found = load_results(output, registry.tables_of)
    if outcome.failed and not outcome.finished:
        raise MidnetBenchError(f"{output}: all trials failed: {found.failures['reason'].iloc[0]}")
    return found


def results(directory: str | Path) -> Results:
    """The results in a campaign's folder; columns have the types that the experiment declares.

    Args:
        directory: with ``campaign.sqlite``, or with the files that a report wrote.

    Raises:
        InputError: neither is there, or it is damaged, foreign or of a newer version.
    """

    def declared(definition: Definition, folder: Path) -> Tables:
        try:
            registry.experiment_in(definition, folder)
        except InputError:  # its file has gone or does not count: the numbers can be read all the same
            return {}
        return registry.tables_of(definition, folder)

    return load_results(directory, declared)


def compare(*campaigns: Folder, by: str | None = None, baseline: str | None = None) -> pd.DataFrame:
    """Differences of the main scores between campaigns, on the seeds that they share with the first.

    Args:
        campaigns: two or more; or one, whose parts are compared.
        by: a factor of the grid of the only campaign.
        baseline: its value with which the others are compared; the first unless given.

    Returns:
        A row for each score and cell: ``difference`` with ``low`` and ``high`` (95 %), ``p_holm``,
        ``verdict``.

    Raises:
        InputError: they cannot be compared; the message says why.
    """
    return frame_of(comparison.compare([_folder(one) for one in campaigns], by, baseline).differences)


def verify(campaign: Folder) -> pd.DataFrame:
    """The paper's claims that a campaign bears on, each with its ``verdict``.

    Raises:
        InputError: the paper states nothing about it.
    """
    return frame_of(claims.verify(_folder(campaign)).table)


def error_causes(campaign: Folder, seed: int | None = None) -> dict[str, pd.DataFrame]:
    """The causes of a recorded campaign's misses and false positives: tables by name.

    Args:
        campaign: with ``record=True``.
        seed: to look at this one only.

    Raises:
        InputError: the trials were not recorded.
    """
    return {table.name: frame_of(table) for table in causes.errors(_folder(campaign), seed=seed)}


def frame_of(table: Table) -> pd.DataFrame:
    """A table as a data frame; an estimate takes four columns: value, low, high and n."""
    return pd.read_csv(io.StringIO(table.to_csv())) if table.rows else pd.DataFrame()


def _folder(campaign: Folder) -> Path:
    return campaign.directory if isinstance(campaign, Results) else Path(campaign)
