"""Campaigns by file or by name: those of ``campaigns/`` come with the package."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from midnet_bench.campaign.definition import Campaign, ResolvedCampaign, resolve
from midnet_bench.campaign.definition import load_campaign as load
from midnet_bench.campaign.trial import RunTrials, TrialResult, TrialSpec
from midnet_bench.errors import InputError, nearest_name
from midnet_bench.experiments import registry
from midnet_bench.workflows.shipped import shipped_folder

RECORDED_TRIALS = 4  # a detection campaign of up to so many trials is recorded by default


def packaged_campaigns() -> dict[str, Path]:
    """The campaign files that come with the package, by name, in alphabetical order."""
    found = {path.stem: path for path in shipped_folder("campaigns", "campaigns").glob("*.yaml")}
    return dict(sorted(found.items()))


def campaign_file(name_or_path: str | Path) -> Path:
    """The file that is meant: the one at this path, else the packaged campaign of this name.

    Raises:
        InputError: there is neither.
    """
    path = Path(name_or_path)
    if path.is_file():
        return path
    packaged = packaged_campaigns()
    name = str(name_or_path)
    if name in packaged:
        return packaged[name]
    if path.stem in packaged:
        raise InputError(
            f"{path}: there is no such file; 'midnet-bench run {path.stem}' runs the packaged campaign"
        )
    if path.suffix or path.name != name:
        raise InputError(f"{path}: there is no such file; the path starts from the working folder")
    raise InputError(f"{name}: neither a campaign file nor a packaged campaign{nearest_name(name, packaged)}")


def summary_of(path: Path) -> str:
    """What a campaign is for, in one line: the first sentence of its file's leading comment; else empty."""
    comment = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        comment.append(line.removeprefix("#").strip())
    sentence, stop, _ = " ".join(comment).partition(". ")
    return sentence + stop.strip()


def load_campaign(name_or_path: str | Path) -> Campaign:
    """A campaign, every cell checked against its experiment.

    Args:
        name_or_path: a YAML file, or the name of a packaged campaign such as ``"labyrinth"``.

    Raises:
        InputError: in one line, naming the file and the key.
    """
    campaign = load(campaign_file(name_or_path))
    resolve(campaign, registry)
    return campaign


def recorded_if_small(campaign: ResolvedCampaign) -> ResolvedCampaign:
    """The campaign, with frames and causes of errors kept if it is a small one of the detection test.

    Parameters, trial ids and the store's definition are those of the campaign without recording, so that more
    trials can be added to it; its tables are the same, with ``recorded`` and ``errors`` added.

    Args:
        campaign: of up to ``RECORDED_TRIALS`` trials; a larger one, one that is recorded anyway, and one that
            cannot be recorded (a network between guards and MIDNet) is returned as it is.
    """
    definition = campaign.definition
    if definition.experiment != "detection" or definition.cells * definition.trials > RECORDED_TRIALS:
        return campaign
    model = registry.experiment(definition.experiment).model
    try:
        for cell in campaign.cells:
            model.parse({**TrialSpec("", cell, 0).settings, "record": True}, definition.experiment)
    except InputError:
        return campaign
    return replace(campaign, run_trials=partial(_run_recorded, campaign.run_trials))


def _run_recorded(run_trials: RunTrials, specs: Sequence[TrialSpec]) -> Sequence[TrialResult | Exception]:
    return run_trials([replace(spec, parameters={**spec.parameters, "record": True}) for spec in specs])
