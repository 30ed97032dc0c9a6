"""``render_trial`` writes files that other programs open, the same ones for the same trial."""

import re
import subprocess
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from midnet_bench.campaign.trial import Scalar
from midnet_bench.drawing.palette import WOOD
from midnet_bench.errors import InputError
from midnet_bench.workflows.render import render_trial

FRAMES = 3
SMALL: dict[str, Scalar] = {"robots": 2, "frames": FRAMES, "engine": "fast"}
PICTURES = ["arena.png", "grids.png", "detections.png"]


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("rendered") / "made" / "here"
    told: list[tuple[int, int]] = []
    paths = render_trial(
        "detection", SMALL, 5, folder, FRAMES, progress=lambda done, of: told.append((done, of))
    )
    assert [path.name for path in paths] == [*PICTURES, "trial.mp4", "storyboard.png"]
    assert told == [(number, FRAMES) for number in range(1, FRAMES + 1)]
    assert sorted(path.name for path in folder.iterdir()) == sorted(path.name for path in paths)
    return folder


def test_pictures_open(rendered: Path) -> None:
    for name in [*PICTURES, "storyboard.png"]:
        picture = cv2.imread(str(rendered / name))
        assert picture is not None
        assert min(picture.shape[:2]) > 500
        assert len(np.unique(picture.astype(np.int64) @ (1, 256, 65536))) > 20


def test_the_clip_plays_anywhere_and_has_every_frame(rendered: Path) -> None:
    film = cv2.VideoCapture(str(rendered / "trial.mp4"))
    assert film.get(cv2.CAP_PROP_FPS) == 10.0
    pictures = []
    while True:
        there, picture = film.read()
        if not there:
            break
        pictures.append(picture)
    film.release()
    held = 20  # two seconds of the last frame, which has the outcome
    assert len(pictures) == FRAMES + held
    assert np.abs(pictures[-held].astype(int) - pictures[-1]).mean() < 1.0
    assert {picture.shape for picture in pictures} == {(720, 1280, 3)}
    # the middle of the western wall, blue first, through a lossy codec
    assert pictures[-1][360, 36] == pytest.approx(np.array(WOOD[::-1]), abs=8)
    assert (pictures[0] != pictures[-1]).any(axis=2).sum() > 500
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(rendered / "trial.mp4")]
    said = subprocess.run(command, capture_output=True, text=True, check=False).stderr
    assert re.search(r"Video: h264 .*yuv420p", said)
    content = (rendered / "trial.mp4").read_bytes()
    assert content.index(b"moov") < content.index(b"mdat"), "a browser cannot begin before the end"


@pytest.mark.slow
def test_same_seed_same_bytes_and_the_last_frame_unless_asked(rendered: Path, tmp_path: Path) -> None:
    render_trial("detection", SMALL, 5, tmp_path)
    for name in [*PICTURES, "storyboard.png"]:
        assert (tmp_path / name).read_bytes() == (rendered / name).read_bytes()


@pytest.mark.slow
def test_another_seed_another_picture_and_no_clip_unless_wanted(rendered: Path, tmp_path: Path) -> None:
    done: list[int] = []
    paths = render_trial(
        "detection", SMALL, 6, tmp_path, 2, clip=False, progress=lambda number, most: done.append(number)
    )
    assert [path.name for path in paths] == PICTURES
    assert not (tmp_path / "trial.mp4").exists()
    assert done == [1], "the trial goes on after its picture"
    for path in paths:
        assert path.read_bytes() != (rendered / path.name).read_bytes()


@pytest.mark.slow
def test_a_labyrinth_of_one_frame_and_its_speed(tmp_path: Path) -> None:
    # the time limit is shorter than a frame
    paths = render_trial("labyrinth", {"time_limit_s": 0.05, "engine": "fast"}, 1, tmp_path, speed=4.0)
    assert [path.name for path in paths] == [*PICTURES, "trial.mp4", "storyboard.png"]
    video = cv2.VideoCapture(str(tmp_path / "trial.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == 20.0
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 1 + 40  # two seconds of it more
    video.release()


def test_a_trial_that_ends_before_the_frame_that_is_asked_for(tmp_path: Path) -> None:
    gone: dict[str, Scalar] = {"escape_distance_m": 0.0, "escape_radius_m": 5.0, "capture": "detected"}
    done: list[int] = []
    with pytest.raises(InputError) as told:
        render_trial(
            *("labyrinth", {**gone, "intruders": 1}, 2, tmp_path, 100),
            clip=False,
            progress=lambda number, most: done.append(number),
        )
    assert 0 < len(done) < 100
    assert f"frame: 100 is out of range; this trial ended with frame {len(done)}" in str(told.value)


STILL_LIFE = """
from contextlib import contextmanager
from dataclasses import dataclass, replace
from midnet_bench.campaign.trial import TrialResult
from midnet_bench.drawing.scene import Demo
from midnet_bench.experiments.registry import Experiment, Trials
from midnet_bench.io.checked_yaml import Parameters
from midnet_bench.settings import option
from tests.drawing.hand_made import setup_and_scene

@dataclass(frozen=True)
class StillParameters(Parameters):
    frames: int = option(2, "How often the same is seen.", ge=1)

@contextmanager
def demo(parameters, seed):
    setup, scene = setup_and_scene("map1", seed)
    scene = replace(scene, explanation=None)
    scenes = (replace(scene, frame=number) for number in range(1, parameters.frames + 1))
    yield Demo(setup, parameters.frames, scenes)

STILL = Experiment(name="still", summary="Nothing moves.", parameters=StillParameters,
                   trials=Trials(run=lambda parameters, seed: TrialResult({}, 1.0), demo=demo))
"""


def test_an_experiment_of_ones_own_is_drawn_without_explanations(tmp_path: Path) -> None:
    (tmp_path / "still.py").write_text(STILL_LIFE)
    made = tmp_path / "made"
    paths = render_trial(f"{tmp_path}/still.py:STILL", {"frames": 3}, 4, str(made), clip=False)
    assert [path.name for path in paths] == ["arena.png", "detections.png"]
    assert all(path.is_file() for path in paths)


@pytest.mark.parametrize(
    ("experiment", "parameters", "frame", "speed", "message"),
    [
        ("detection", SMALL, 0, 2.0, "frame: 0 is out of range; the trial has frames 1 to 3"),
        ("detection", SMALL, 4, 2.0, "frame: 4 is out of range; the trial has frames 1 to 3"),
        ("detection", SMALL, 1, 0.0, "speed: 0 is out of range"),
        ("detection", {"robots": 0}, 1, 2.0, "detection: robots: "),
        ("mapping", {}, 1, 2.0, "'mapping' has no guards"),
    ],
)
def test_wrong_arguments_are_named_and_make_no_folder(
    tmp_path: Path, experiment: str, parameters: dict[str, Scalar], frame: int, speed: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        render_trial(experiment, parameters, 5, tmp_path / "new", frame, speed=speed)
    assert not (tmp_path / "new").exists()


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("here already")
    with pytest.raises(InputError, match="cannot be made"):
        render_trial("detection", SMALL, 5, tmp_path / "file" / "out", 1)
