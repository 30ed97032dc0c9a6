"""The page that the tests of this folder read and play."""

import shutil
from pathlib import Path

import pytest

from midnet_bench.workflows.report import PAGE, write_report


@pytest.fixture(scope="session")
def recorded_page(_recorded_campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``report.html`` of a campaign with recorded trials, beside its files; only to be read."""
    folder = Path(shutil.copytree(_recorded_campaign, tmp_path_factory.mktemp("page") / "recorded"))
    write_report(folder)
    return folder / PAGE
