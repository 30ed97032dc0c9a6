"""What the shell offers when the user presses the tab key: names instead of guesses."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import typer


def experiments(incomplete: str) -> list[str]:
    """Experiments by name."""
    from midnet_bench.experiments.registry import names

    return _beginning(incomplete, names())


def parameters(incomplete: str) -> list[str]:
    """Experiments, then parameters of any of them."""
    from midnet_bench.experiments.registry import names

    return _beginning(incomplete, [*names(), *_keys(names())])


def campaigns(incomplete: str) -> list[str]:
    """Packaged campaigns, then campaign files whose path begins so."""
    from midnet_bench.workflows.campaigns import packaged_campaigns

    return [*_beginning(incomplete, packaged_campaigns()), *_paths(incomplete, ".yaml")]


def arenas(incomplete: str) -> list[str]:
    """Packaged arenas, then YAML files whose path begins so."""
    from midnet_bench.arena.arena import arena_names

    return [*_beginning(incomplete, arena_names()), *_paths(incomplete, ".yaml")]


def results(incomplete: str) -> list[str]:
    """Folders with a campaign's results: those in ``results/``, and any whose path begins so."""
    usual = [str(folder) for folder in sorted(Path("results").glob("*")) if has_results(folder)]
    return list(dict.fromkeys([*_beginning(incomplete, usual), *_paths(incomplete, "")]))


def exported(incomplete: str) -> list[str]:
    """What has guards: experiments by name, then folders with results."""
    return [*_beginning(incomplete, ("detection", "labyrinth")), *results(incomplete)]


def settings(context: typer.Context, incomplete: str) -> list[str]:
    """Parameters of the experiment that the command runs, each with ``=`` behind it."""
    from midnet_bench.experiments.registry import names

    named = str(context.params.get("experiment") or context.info_name)
    return [f"{key}=" for key in _beginning(incomplete, _keys([named] if named in names() else names()))]


def _keys(experiments: Iterable[str]) -> list[str]:
    from midnet_bench.experiments.registry import parameters_model

    return [key for name in experiments for key in parameters_model(name).defaults()]


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return [name for name in dict.fromkeys(names) if name.startswith(incomplete)]


def has_results(folder: Path) -> bool:
    """Whether a campaign's results are in it."""
    return any((folder / name).is_file() for name in ("campaign.sqlite", "configuration.json"))


def _paths(incomplete: str, suffix: str) -> Iterator[str]:
    """Folders, and files that end in ``suffix``, whose path begins with ``incomplete``."""
    folder, slash, beginning = incomplete.rpartition("/")
    try:
        found = sorted(Path(folder + slash).iterdir()) if incomplete else []
    except OSError:
        return
    for path in found:
        if not path.name.startswith(beginning):
            continue
        if path.is_dir():
            yield str(path) if suffix == "" and has_results(path) else f"{path}/"
        elif suffix and path.name.endswith(suffix):
            yield str(path)
