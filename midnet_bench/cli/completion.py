"""What the shell offers when the user presses the tab key: names instead of guesses."""

from collections.abc import Iterator
from pathlib import Path

import typer


def experiments(incomplete: str) -> list[str]:
    """Experiments by name."""
    from midnet_bench.experiments.registry import names

    return [name for name in names() if name.startswith(incomplete)]


def parameters(incomplete: str) -> list[str]:
    """Experiments, then parameters of any of them."""
    from midnet_bench.experiments.registry import names, parameters_model

    keys = [key for name in names() for key in parameters_model(name).defaults()]
    return [key for key in dict.fromkeys([*names(), *keys]) if key.startswith(incomplete)]


def campaigns(incomplete: str) -> list[str]:
    """Packaged campaigns, then campaign files whose path begins so."""
    from midnet_bench.workflows.campaigns import packaged_campaigns

    named = [name for name in packaged_campaigns() if name.startswith(incomplete)]
    return named + list(_paths(incomplete, ".yaml"))


def arenas(incomplete: str) -> list[str]:
    """Packaged arenas, then YAML files whose path begins so."""
    from midnet_bench.arena.arena import arena_names

    named = [name for name in arena_names() if name.startswith(incomplete)]
    return named + list(_paths(incomplete, ".yaml"))


def results(incomplete: str) -> list[str]:
    """Folders with a campaign's results: those in ``results/``, and any whose path begins so."""
    usual = [f"{folder}" for folder in sorted(Path("results").glob("*")) if _has_results(folder)]
    return list(
        dict.fromkeys([name for name in usual if name.startswith(incomplete)] + list(_paths(incomplete, "")))
    )


def exported(incomplete: str) -> list[str]:
    """What has guards: experiments by name, then folders with results."""
    named = [name for name in ("detection", "labyrinth") if name.startswith(incomplete)]
    return named + results(incomplete)


def settings(context: typer.Context, incomplete: str) -> list[str]:
    """Parameters of the experiment that the command runs, each with ``=`` behind it."""
    from midnet_bench.experiments.registry import names as experiment_names
    from midnet_bench.experiments.registry import parameters_model

    named = str(context.params.get("experiment") or context.info_name)
    names = [named] if named in experiment_names() else experiment_names()
    keys = {key: None for name in names for key in parameters_model(name).defaults()}
    return [f"{key}=" for key in keys if key.startswith(incomplete)]


def _has_results(folder: Path) -> bool:
    return any((folder / name).is_file() for name in ("campaign.sqlite", "configuration.json"))


def _paths(incomplete: str, suffix: str) -> Iterator[str]:
    """Folders, and files that end in ``suffix``, whose path begins with ``incomplete``."""
    if not incomplete:
        return
    place = Path(incomplete)
    parent = place if incomplete.endswith("/") else place.parent
    beginning = "" if incomplete.endswith("/") else place.name
    try:
        found = sorted(path for path in parent.iterdir() if path.name.startswith(beginning))
    except OSError:
        return
    for path in found:
        if path.is_dir():
            yield str(path) if suffix == "" and _has_results(path) else f"{path}/"
        elif suffix and path.name.endswith(suffix):
            yield str(path)
