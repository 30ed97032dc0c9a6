"""A film is there in full or not at all; a storyboard has the scenes that tell the most."""

from dataclasses import replace
from pathlib import Path
from unittest import mock

import cv2
import numpy as np
import pytest

from midnet_bench.drawing.films import Storyboard, mp4_file
from midnet_bench.drawing.scene import Chase, Scene
from midnet_bench.errors import InputError, MidnetBenchError
from midnet_bench.scoring.frame_counts import Ratios
from tests.drawing.hand_made import setup_and_scene

SETUP, SCENE = setup_and_scene()


def write_40_pictures(path: Path, fails_at: int | None = None, side_px: int = 320) -> None:
    rng = np.random.default_rng(1)
    with mp4_file(path, side_px, side_px, 10.0) as append:
        for number in range(40):
            if number == fails_at:
                raise KeyError(number)
            append(rng.integers(0, 256, (side_px, side_px, 3), dtype=np.uint8))


@pytest.mark.slow
def test_a_video_has_all_its_pictures_and_its_folder_is_made(tmp_path: Path) -> None:
    write_40_pictures(tmp_path / "new" / "video.mp4")
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["video.mp4"]
    video = cv2.VideoCapture(str(tmp_path / "new" / "video.mp4"))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 40
    video.release()


def test_a_name_is_neither_an_option_nor_a_protocol(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("--exact", "pipe:1"):
        with mp4_file(Path(folder, "film.mp4"), 64, 48, 10.0) as append:
            append(np.zeros((48, 64, 3), dtype=np.uint8))
        assert (tmp_path / folder / "film.mp4").stat().st_size > 0


def test_an_error_on_the_way_leaves_nothing_and_an_older_video_alone(tmp_path: Path) -> None:
    with pytest.raises(KeyError):
        write_40_pictures(tmp_path / "video.mp4", fails_at=30)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "video.mp4").write_text("older")
    with pytest.raises(KeyError):
        write_40_pictures(tmp_path / "video.mp4", fails_at=30)
    assert [path.read_text() for path in tmp_path.iterdir()] == ["older"]


def test_a_place_that_cannot_be_written_is_wrong_input(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("here already")
    with pytest.raises(InputError, match="cannot be written") as told:
        write_40_pictures(tmp_path / "file" / "video.mp4")
    assert "\n" not in str(told.value)


def test_ffmpeg_that_fails_is_told_in_a_line(tmp_path: Path) -> None:
    # half a pixel of colour: yuv420p takes even sizes only
    with pytest.raises(MidnetBenchError, match="cannot be written") as told:
        write_40_pictures(tmp_path / "odd.mp4", side_px=321)
    assert not isinstance(told.value, InputError)
    assert "\n" not in str(told.value)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_no_wrong_input(small_disk: Path) -> None:
    with pytest.raises(MidnetBenchError, match="No space") as told:
        write_40_pictures(small_disk / "noise.mp4", side_px=320)
    assert not isinstance(told.value, InputError)
    assert list(small_disk.iterdir()) == []


@pytest.mark.parametrize("frames", [1, 5, 12, 13, 48, 49, 50, 333])
def test_a_storyboard_spreads_its_scenes_evenly(frames: int) -> None:
    board = Storyboard(SETUP)
    for number in range(1, frames + 1):
        board.offer(Scene(number / 5.0, number, [], [], []))
    numbers = [scene.frame for scene in board.chosen()]
    assert len(numbers) == min(frames, 6)
    assert numbers[0] == 1
    assert numbers[-1] == frames
    if len(numbers) > 1:
        gaps = np.diff(numbers)
        assert gaps.min() > 0
        assert gaps.max() <= 0.4 * frames + 1
    if frames in (5, 13):
        assert board.page().shape[1] == 3 * (400 + 14) + 14
        assert board.page().shape[0] > 2 * 400


def test_a_storyboard_shows_each_catch_and_ends_with_the_outcome() -> None:
    board = Storyboard(SETUP)
    events = {78: "intruder 1 caught by guard 2, 15.6 s", 203: "intruder 2 escaped, 40.6 s"}
    for number in range(1, 204):
        told = [text for frame, text in events.items() if frame <= number]
        board.offer(replace(SCENE, time_s=number / 5.0, frame=number, chase=Chase(2, 0, 0, told)))
    chosen = board.chosen()
    assert {78, 203} <= {scene.frame for scene in chosen}
    assert chosen[-1].remark == events[203]
    assert len(chosen) == 6


def test_a_storyboard_writes_the_scores_so_far_under_each_picture_also_where_they_stay() -> None:
    board = Storyboard(SETUP)
    for number in (1, 2):
        scores = Ratios(precision=1.0, recall=0.5, f1=0.667)
        board.offer(replace(SCENE, frame=number, time_s=number / 5.0, chase=None, so_far=scores))
    with mock.patch("midnet_bench.drawing.films.write") as write:
        board.page()
    texts = [call.args[3] for call in write.call_args_list]
    assert texts.count("so far: recall 0.50, precision 1.00") == 2
