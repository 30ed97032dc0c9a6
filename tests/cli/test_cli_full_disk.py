"""A command whose disk fills up was not wrong: exit code 1."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.cli.command import midnet_bench


def test_a_map_for_which_the_disk_has_no_room_ends_with_1(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small disk needs root")
    try:
        done = midnet_bench("map", "map2", "--exact", "-o", disk, folder=tmp_path)
    finally:
        subprocess.run(["umount", str(disk)], check=True)
    assert done.returncode == 1
    assert "cannot be written: No space left on device; make room" in done.stderr.splitlines()[-1]
