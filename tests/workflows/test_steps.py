"""``errors --frame N --steps``: one frame of any trial, walked through section IV."""

import re
from pathlib import Path

import pytest

import midnet_bench as mb
from midnet_bench.campaign.trial import Scalar
from tests.cli.command import midnet_bench, one_line_of_complaint, rows, worked
from tests.conftest import campaign_folder
from tests.stores import detection_store


def steps(folder: Path, *arguments: object) -> str:
    done = worked("errors", *arguments, "--steps", "steps", folder=folder)
    assert all((folder / name).stat().st_size > 100 for name in done.stdout.split())
    return (folder / "steps" / "steps.html").read_text()


@pytest.mark.slow
def test_the_page_has_the_numbers_of_its_frame(tmp_path: Path) -> None:
    trial: dict[str, Scalar] = {"engine": "fast", "frames": 12}
    detection_store(tmp_path / "d", {3: {1: (0.9, 0.5, 0.6)}}, parameters=trial)
    page = steps(tmp_path, "d", "--frame", 9, "--guard", 2)
    with mb.simulate(seed=1, explain=True, robots=3, **trial) as frames:
        frame = [next(frames) for _ in range(9)][-1]
    found = frame.midnet.explanation
    assert found is not None
    counts = [len(view.found) for view in found.views]
    assert f"{', '.join(map(str, counts))}, {sum(counts)} in all" in page
    assert f"{len(found.removed)} of the {sum(counts)}" in page
    assert f"{len(frame.midnet.detections)} boxes are left" in page
    assert "Guard 2" in page
    assert re.findall(r'<img src="([\w.-]+)"', page) == ["steps-grids.png", "steps-fusion.png"]


@pytest.mark.slow
def test_a_single_guard_has_no_tree_and_a_labyrinth_has_a_page(tmp_path: Path) -> None:
    run = {"experiment": "labyrinth", "grid": {"robots": [1], "intruders": [1]}, "trials": 1}
    campaign_folder(tmp_path / "lab", **run, parameters={"engine": "fast", "time_limit_s": 1})
    page = steps(tmp_path, "lab", "--frame", 5)
    assert "Algorithm 3" not in page
    assert "labyrinth, seed 1, frame 5 (1.0 s)" in page


@pytest.mark.slow
@pytest.mark.parametrize(
    ("detector", "frame", "named"),
    [
        ("midnet", "--frame 6", "--frame 6"),
        ("midnet", "--frame 5 --guard 3", "--guard 3"),
        ("midnet", "", "--steps"),
        ("clusters", "--frame 3", "detector=clusters"),
    ],
)
def test_wrong_frames_and_other_detectors_get_one_line(
    detector: str, frame: str, named: str, tmp_path: Path
) -> None:
    parameters: dict[str, Scalar] = {"engine": "fast", "frames": 5, "detector": detector}
    detection_store(tmp_path / "d", {2: {1: (0.9, 0.5, 0.6)}}, parameters=parameters)
    done = midnet_bench("errors", "d", *frame.split(), "--steps", "steps", folder=tmp_path)
    assert named in one_line_of_complaint(done)


@pytest.mark.slow
def test_a_recorded_frame_has_the_boxes_of_its_replay(tmp_path: Path) -> None:
    recorded = ("--engine", "fast", "--robots", 2, "--frames", 12, "--format", "mcap", "-q")
    worked("export", "detection", *recorded, "-o", "drive.mcap", folder=tmp_path)
    worked("map", "--exact", "map1", "-o", "m", folder=tmp_path)
    common = ("replay", "drive.mcap", "--map", "m/map.yaml", "--preset", "paper", "-q")
    worked(*common, "--steps", 8, "-o", "steps", folder=tmp_path)
    worked(*common, "-o", "played", folder=tmp_path)
    boxes = [row for row in rows(tmp_path / "played" / "boxes.csv") if row["frame"] == "8"]
    assert f"{len(boxes)} boxes are left" in (tmp_path / "steps" / "steps.html").read_text()
    done = midnet_bench(*common, "--steps", 99, folder=tmp_path)
    assert "--steps 99" in one_line_of_complaint(done)
