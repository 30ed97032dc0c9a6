"""A part of a recording by from_s and to_s, poses that are no robot's, and what an error names."""

import pytest

from midnet_bench.geometry import Pose2D
from tests.cli.command import midnet_bench, one_line_of_complaint
from tests.recording import recordings as made
from tests.recording.recordings import Drive, replayed

DRIVE = Drive(movers={"red": made.on_the_way(6.0)})


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    folder = tmp_path_factory.mktemp("part")
    labels = made.write_labels(folder / "truth.csv", DRIVE.labels(), by="scan_index")
    bag = made.write_bag(folder, [*made.scan_messages(DRIVE), *made.tf_messages(DRIVE)])
    return {"files": bag, "map": str(made.write_map(folder)), "truth": str(labels)}


@pytest.mark.slow
def test_a_part_has_the_boxes_of_the_whole_at_its_scans(tmp_path, keys):
    whole, part = (
        replayed(folder=tmp_path, **keys, **limits) for limits in ({}, {"from_s": 1.95, "to_s": 3.05})
    )
    # the first scan comes at 0.5 s, ten a second: labels by scan_index hold
    scans = set(map(str, range(15, 26)))
    wanted = [{**row, "frame": ""} for row in whole.boxes if row["scan_index"] in scans]
    assert [{**row, "frame": ""} for row in part.boxes] == wanted
    assert part.score()["recall"] == 1.0
    assert {row["scan_index"] for row in part.boxes} == scans


@pytest.mark.parametrize(
    ("typed", "named"),
    [
        (("--pose", "/odmo"), "--pose: no topic"),
        (("--map", "/mpa"), "--map: "),
        (("--truth", "red=/red_poze"), "--truth: red: no topic"),
        (("--set", "thresh_global=300"), "thresh_global: "),
        (("--set", "min_returns=-1"), "min_returns: "),
    ],
)
def test_an_error_names_what_was_typed(tmp_path, keys, typed, named):
    prior = () if "--map" in typed else ("--map", keys["map"])
    bag = keys["files"]
    if "/mpa" in typed:
        bag = made.write_bag(tmp_path, [made.map_message(), *made.scan_messages(DRIVE)])
        typed = (*typed, "--pose", "at:0,0,0")
    said = one_line_of_complaint(midnet_bench("replay", bag, *prior, *typed, folder=tmp_path))
    assert named in said


@pytest.mark.parametrize(
    ("written", "named"),
    [
        ("from_s: 99", "setup.yaml: from_s: "),
        ("{from_s: 3, to_s: 2}", "setup.yaml: to_s: "),
        ("from_s: 4.97", "change from_s"),
    ],
)
def test_an_error_names_the_setup_s_file_and_key(tmp_path, keys, written, named):
    (tmp_path / "setup.yaml").write_text(written)
    given = ("replay", keys["files"], "--map", keys["map"], "--setup", "setup.yaml")
    said = one_line_of_complaint(midnet_bench(*given, folder=tmp_path))
    assert named in said


@pytest.mark.slow
@pytest.mark.parametrize("topic", ["/move_base_simple/goal", "/initialpose", "/truth/red/pose"])
def test_a_goal_is_never_proposed_as_a_pose(tmp_path, topic):
    goal = made.track_messages([(1.0, Pose2D(1.0, 1.0, 0.0))], topic=topic)
    bag = made.write_bag(tmp_path, [*made.scan_messages(DRIVE), *goal])
    listed = midnet_bench("replay", bag, folder=tmp_path).stderr
    assert f"--pose {topic}" not in listed
    assert "at:X,Y,YAW" in listed
    driven = made.pose_messages(DRIVE, "odometry", "/odom")
    for said in driven:
        said.message.fields["header"]["frame_id"] = "odom"
    bag = made.write_bag(tmp_path, [*made.scan_messages(DRIVE), *goal, *driven])
    listed = midnet_bench("replay", bag, folder=tmp_path).stderr
    assert "--pose /odom --start found" in listed
