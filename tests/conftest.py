"""Real trials that tests share. Heavy rooms are imported on first use."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest

from midnet_bench import compiled

# a case that takes long on a busy machine says nothing about the code
hypothesis.settings.register_profile("any machine", deadline=None, max_examples=50)
hypothesis.settings.register_profile("quick", deadline=None, max_examples=30)


def pytest_configure(config: pytest.Config) -> None:
    """A property has 30 examples in ``make test`` and 50 in ``make test-all``."""
    compiled.collect_garbage_rarely()
    hypothesis.settings.load_profile("quick" if config.option.markexpr == "not slow" else "any machine")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests first: a process that meets one at the end keeps the others waiting.

    A file stays in one piece, for what its tests share would be made again.
    """
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="session", autouse=True)
def _state(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What runs write down of the code that they ran goes into no home of anybody's."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of 256 KiB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(disk)]
    if os.geteuid() or subprocess.run(command, capture_output=True).returncode:
        pytest.skip("mounting a small disk needs root")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


@pytest.fixture
def full_disk(small_disk: Path) -> Path:
    """The same without a free byte."""
    (small_disk / "ballast").write_bytes(bytes(256 * 1024))
    return small_disk


@pytest.fixture
def trials_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Campaigns start no workers: their trials run one by one in this process."""
    from midnet_bench.campaign.pool import LocalPool
    from tests.cli.command import without_workers

    monkeypatch.setattr(LocalPool, "outcomes", without_workers)


def campaign_folder(directory: Path, **campaign: Any) -> Path:
    """``directory`` with a campaign's store and CSV files; its trials run one by one in this process."""
    from midnet_bench.campaign.definition import Campaign, resolve
    from midnet_bench.campaign.provenance import collect
    from midnet_bench.campaign.store import FILE_NAME, export_csv, open_or_create
    from midnet_bench.campaign.trial import Outcome, encode_tables
    from midnet_bench.experiments import registry

    resolved = resolve(Campaign.model_validate(campaign), registry)
    directory.mkdir(parents=True)
    with open_or_create(directory / FILE_NAME, resolved.definition) as store:
        run_id = store.begin_run(collect(resolved.definition.base_seed, ["midnet-bench"]))
        for spec in resolved.trials():
            (result,) = resolved.run_trials([spec])
            outcome = Outcome(spec.trial_id, 1.0, result.simulated_s, encode_tables(result))
            store.record(run_id, spec, outcome)
        store.end_run(run_id)
        export_csv(store, directory)
    return directory


@pytest.fixture(scope="session")
def _detection_campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return campaign_folder(
        tmp_path_factory.mktemp("shared") / "detection",
        experiment="detection",
        grid={"robots": [1, 5]},
        trials=2,
        parameters={"frames": 20},
    )


@pytest.fixture
def detection_campaign(_detection_campaign: Path, tmp_path: Path) -> Path:
    """A real detection campaign, for you to change: 1 and 5 robots, seeds 1 and 2, 20 frames."""
    return Path(shutil.copytree(_detection_campaign, tmp_path / "detection"))


@pytest.fixture(scope="session")
def _recorded_campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return campaign_folder(
        tmp_path_factory.mktemp("shared") / "recorded",
        experiment="detection",
        grid={"robots": [1, 3]},
        trials=2,
        parameters={"frames": 10, "engine": "fast", "record": True},
    )


@pytest.fixture
def recorded_campaign(_recorded_campaign: Path, tmp_path: Path) -> Path:
    """A real detection campaign, for you to change: 1 and 3 robots, seeds 1 and 2, 10 recorded frames."""
    return Path(shutil.copytree(_recorded_campaign, tmp_path / "recorded"))


@pytest.fixture(scope="session")
def _labyrinth_campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return campaign_folder(
        tmp_path_factory.mktemp("shared") / "labyrinth",
        experiment="labyrinth",
        grid={"intruders": [1], "robots": [1, 2]},
        trials=2,
        parameters={"time_limit_s": 4},
    )


@pytest.fixture
def labyrinth_campaign(_labyrinth_campaign: Path, tmp_path: Path) -> Path:
    """A real labyrinth campaign, for you to change: 1 and 2 robots, seeds 1 and 2, 4 s each."""
    return Path(shutil.copytree(_labyrinth_campaign, tmp_path / "labyrinth"))
