"""``errors --frame N --steps``: one frame of any trial, walked through section IV."""

import re
from pathlib import Path

import midnet_bench as mb
from tests.cli.command import midnet_bench, one_line_of_complaint, rows


def steps(folder: Path, *arguments: object) -> str:
    done = midnet_bench("errors", *arguments, "--steps", "steps", folder=folder)
    assert done.returncode == 0, done.stderr
    for name in done.stdout.split():
        assert (folder / name).stat().st_size > 100
    return (folder / "steps" / "steps.html").read_text()


def test_the_page_has_the_numbers_of_its_frame(tmp_path: Path) -> None:
    trial = {"engine": "fast", "robots": 3, "frames": 12}
    ran = midnet_bench(
        "detection", "--engine", "fast", "--robots", 3, "--frames", 12, "-q", "-o", "d", folder=tmp_path
    )
    assert ran.returncode == 0
    page = steps(tmp_path, "d", "--frame", 9, "--guard", 2)
    with mb.simulate(seed=1, explain=True, **trial) as frames:
        frame = [next(frames) for _ in range(9)][-1]
    found = frame.midnet.explanation
    assert found is not None
    counts = [len(view.found) for view in found.views]
    assert f"{', '.join(map(str, counts))}, {sum(counts)} in all" in page
    assert f"{len(found.removed)} of the {sum(counts)}" in page
    assert f"{len(frame.midnet.detections)} boxes are left" in page
    assert "Guard 2" in page
    assert re.findall(r'<img src="([\w.-]+)"', page) == ["steps-grids.png", "steps-fusion.png"]


def test_a_single_guard_has_no_tree_and_a_labyrinth_has_a_page(tmp_path: Path) -> None:
    common = ("--engine", "fast", "--set", "time_limit_s=3", "--seeds", 1, "--intruders", 1, "-q")
    ran = midnet_bench("labyrinth", *common, "--robots", 1, "-o", "lab", folder=tmp_path)
    assert ran.returncode == 0
    page = steps(tmp_path, "lab", "--frame", 5)
    assert "Algorithm 3" not in page
    assert "labyrinth, seed 1, frame 5 (1.0 s)" in page


def test_wrong_frames_and_other_detectors_get_one_line(tmp_path: Path) -> None:
    common = ("--engine", "fast", "--frames", 5, "--robots", 2, "-q")
    midnet_bench("detection", *common, "-o", "d", folder=tmp_path)
    midnet_bench("detection", *common, "--detector", "clusters", "-o", "c", folder=tmp_path)
    for arguments, named in (
        (("d", "--frame", 6), "--frame 6"),
        (("d", "--frame", 5, "--guard", 3), "--guard 3"),
        (("d",), "--steps"),
        (("c", "--frame", 3), "detector=clusters"),
    ):
        done = midnet_bench("errors", *arguments, "--steps", "steps", folder=tmp_path)
        assert named in one_line_of_complaint(done)


def test_a_recorded_frame_has_the_boxes_of_its_replay(tmp_path: Path) -> None:
    recorded = ("--engine", "fast", "--robots", 2, "--frames", 12, "--format", "mcap", "-q")
    assert midnet_bench("export", "detection", *recorded, "-o", "drive.mcap", folder=tmp_path).returncode == 0
    assert midnet_bench("map", "--exact", "map1", "-o", "m", folder=tmp_path).returncode == 0
    common = ("replay", "drive.mcap", "--map", "m/map.yaml", "--preset", "paper", "-q")
    walked = midnet_bench(*common, "--steps", 8, "-o", "steps", folder=tmp_path)
    assert walked.returncode == 0, walked.stderr
    played = midnet_bench(*common, "-o", "played", folder=tmp_path)
    assert played.returncode == 0, played.stderr
    boxes = [row for row in rows(tmp_path / "played" / "boxes.csv") if row["frame"] == "8"]
    assert f"{len(boxes)} boxes are left" in (tmp_path / "steps" / "steps.html").read_text()
    done = midnet_bench(*common, "--steps", 99, folder=tmp_path)
    assert "--steps 99" in one_line_of_complaint(done)
