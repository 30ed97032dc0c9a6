"""``check``: whether code for a seam keeps to what is agreed, found by running it."""

import ast
import contextlib
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from midnet_bench.campaign.definition import parse_campaign, resolve
from midnet_bench.campaign.pools import LokyPool, WorkersLost
from midnet_bench.campaign.worker import attempt
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.workflows.contracts import CONTRACTS, SEED, Contract

LIMIT_S = 60.0
"""of a short trial in another process"""


@dataclass(frozen=True)
class Checked:
    """What came of a check."""

    seam: str
    """its option"""
    name: str
    """what was checked, with its pin"""
    faults: list[str]
    """a line for each; empty where all is well"""
    frame_ms: float | None
    """median time of a frame of four robots; None with faults, or where it has no part in frames"""


def check(thing: str) -> Checked:
    """What is wrong with the code that ``thing`` names, found with robots in the fast engine's Map 1.

    Args:
        thing: what ``--detector``, ``--fusion``, ``--patrol``, ``--pursuit`` or ``--metric`` takes.

    Raises:
        InputError: there is no such code, or it is for no seam.
    """
    if thing.endswith(".py"):
        raise InputError(f"{thing}: which class? {_classes_in(Path(thing))}")
    contract = _contract_of(thing)
    option, name = contract.seam.option, contract.seam.pinned(thing)
    if contract.seam.is_made_here(name):  # it is what all else is measured with
        return Checked(option, name, [], contract.frame_ms(name))
    run_trials, spec = _trial(contract, next(iter(contract.seam.own)))
    run_trials([spec])  # compiles what it needs: the limit of another process is for the code alone
    elsewhere, faults = _in_another_process(contract, name)
    if faults:  # it hangs, fails or takes its process along
        return Checked(option, name, faults, None)
    faults = list(dict.fromkeys(contract.faults(name)))
    frame_ms = None if faults else contract.frame_ms(name)
    here = attempt(*_trial(contract, name), LIMIT_S, None)
    if not faults and here.payload != elsewhere:
        faults.append(
            "another process gets other results from the same trial: does it go by the order of a set, an "
            "id, the clock or the environment?"
        )
    return Checked(option, name, faults, frame_ms)


def _classes_in(path: Path) -> str:
    """Which names a file of Python offers, without running it. Raises InputError if it cannot be read."""
    try:
        tree = ast.parse(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{path}: cannot be read as Python: {error}") from error
    names = [
        node.name
        for node in tree.body
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_")
    ]
    names += [
        target.id
        for node in tree.body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name) and not target.id.startswith("_")
    ]
    if not names:
        return "It defines none"
    return f"It defines {', '.join(names)}: type {path}:{names[0]}"


def _contract_of(thing: str) -> Contract:
    """Of the seam that has this name, else of the first whose method the class has."""
    complaints = []
    for contract in CONTRACTS:
        try:
            contract.seam.pinned(thing)
            return contract
        except InputError as error:
            complaints.append(str(error))
    seams = [contract.seam for contract in CONTRACTS]
    if all(f"expected {seam.wanted}" in said for seam, said in zip(seams, complaints, strict=True)):
        wanted = " or ".join(f"{seam.wanted} ({seam.option})" for seam in seams)
        raise InputError(f"{thing}: expected {wanted.replace(' or a class with a method', ',')}")
    raise InputError(complaints[0].removeprefix(f"{seams[0].option}: "))


def _trial(contract: Contract, name: str) -> tuple[Any, Any]:
    """A short trial with the code in it: what runs it, and its spec."""
    campaign = parse_campaign(
        {
            "experiment": contract.experiment,
            "parameters": {**contract.short_trial, contract.seam.option: name},
            "trials": 1,
            "base_seed": SEED,
        },
        "check",
    )
    resolved = resolve(campaign, registry)
    (spec,) = resolved.trials()
    return resolved.run_trials, spec


def _in_another_process(contract: Contract, name: str) -> tuple[bytes | None, list[str]]:
    """The tables of a short trial there, and what went wrong."""
    run_trials, spec = _trial(contract, name)
    with tempfile.TemporaryDirectory() as folder:
        pool = LokyPool(1, Path(folder) / "marks")
        try:
            with contextlib.closing(pool.outcomes(run_trials, iter([[spec]]), LIMIT_S, True)) as outcomes:
                (outcome,) = outcomes
        except WorkersLost as lost:
            return None, [f"it takes its process along: {lost}"]
        finally:
            pool.close()
    if outcome.failure is None:
        return outcome.payload, []
    said = outcome.failure.splitlines()[-1]
    return None, [said.split("PluginError: ", 1)[-1]]
