"""A file is there in full or not at all, and a full disk is no wrong input."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.files import temporary_folder, temporary_path, write_atomically
from midnet_bench.io.map_server import save_map
from midnet_bench.io.scan_logs import Trajectory, write_tum


def save_a_map(folder: Path) -> None:
    save_map(OccupancyGrid(np.zeros((100, 100), np.int8), 0.05, (0.0, 0.0)), folder / "map.yaml")


def save_a_trajectory(folder: Path) -> None:
    write_tum(Trajectory(np.zeros(1), np.zeros((1, 3))), folder / "map.tum")


@pytest.mark.parametrize("save", [save_a_map, save_a_trajectory])
def test_a_full_disk_ends_with_1_and_leaves_nothing_behind(full_disk: Path, save) -> None:
    with pytest.raises(
        MidnetBenchError, match=r"map\.\w+: cannot be written: No space .*; make room"
    ) as caught:
        save(full_disk)
    assert not isinstance(caught.value, InputError)
    assert caught.value.exit_code == 1
    assert [path.name for path in full_disk.iterdir()] == ["ballast"]


def test_the_folder_of_a_file_is_made(tmp_path: Path) -> None:
    write_atomically(tmp_path / "new" / "folder" / "a.txt", "one\n")
    assert (tmp_path / "new" / "folder" / "a.txt").read_text() == "one\n"


def test_what_fails_half_way_leaves_the_old_file_and_no_draft(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_atomically(path, "old")

    def write_half() -> None:
        with temporary_path(path) as draft:
            draft.write_text("half of the ne")
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        write_half()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_drafts_of_killed_processes_are_removed_when_the_file_is_written_again(tmp_path: Path) -> None:
    path, mark = tmp_path / "a[1].txt", ".0123456789abcdef.17.new"
    kept = (f".b.txt{mark}", "a[1].txt.new", "my.a[1].txt.v2.new", f"my.a[1].txt{mark}", ".my.a[1].txt.2.new")
    for name in (f".a[1].txt{mark}", f"..a[1].txt{mark}{mark}", *kept):
        (tmp_path / name).write_text("half of a te")
        os.utime(tmp_path / name, (time.time() - 2.0,) * 2)
    for name in (".a[1].txt.fedcba9876543210.18.new", "thesis.a[1].txt.v2.new"):
        (tmp_path / name).mkdir()
        os.utime(tmp_path / name, (time.time() - 2.0,) * 2)
    left = {path.name, "thesis.a[1].txt.v2.new", *kept}
    with temporary_path(path) as in_use, temporary_folder(path) as folder:
        for one in (in_use, folder):
            os.utime(one, (time.time() - 2.0,) * 2)
        write_atomically(path, "text")
        assert {one.name for one in tmp_path.iterdir()} == {in_use.name, folder.name, *left}
        in_use.write_text("text")
    assert {one.name for one in tmp_path.iterdir()} == left


def test_a_draft_that_grew_old_while_the_file_was_written_goes_too(tmp_path: Path) -> None:
    orphan = tmp_path / ".film.mp4.0123456789abcdef.17.new"
    with temporary_path(tmp_path / "film.mp4"):
        orphan.write_text("of an encoder that outlived its process")
        os.utime(orphan, (time.time() - 2.0,) * 2)
    assert [one.name for one in tmp_path.iterdir()] == ["film.mp4"]


def test_links_under_the_names_of_drafts_overwrite_nothing(tmp_path: Path) -> None:
    victim, path = tmp_path / "thesis.txt", tmp_path / "results" / "scores.csv"
    victim.write_text("years of work")
    path.parent.mkdir()
    for name in (f".{path.name}.{os.getpid()}.new", f".{path.name}.0.{os.getpid()}.new", path.name):
        (path.parent / name).symlink_to(victim)
    write_atomically(path, "robots,seed\n")
    assert victim.read_text() == "years of work"
    assert not path.is_symlink()
    assert path.read_text() == "robots,seed\n"


def test_files_get_the_permissions_that_the_user_wants(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "a.txt", "text")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def test_a_place_that_cannot_be_written_is_wrong_input(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written: Not a directory; give another place") as caught:
        write_atomically(tmp_path / "file" / "a.txt", "text")
    assert caught.value.exit_code == 2
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputError, match="cannot be written: Is a directory"):
        write_atomically(tmp_path / "folder", "text")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]
