"""``replay`` on the command line: an exported trial comes back, others' recordings are scored."""

import json
import math
from collections import defaultdict
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from midnet_bench.io.map_server import load_map
from midnet_bench.recording.setup import EVERY, RecordingSetup
from tests.cli.command import REPOSITORY, Done, midnet_bench, one_line_of_complaint, rows, worked
from tests.recording.test_replay_bag import boxes_of

RECORDINGS = REPOSITORY.parent / "shared" / "data" / "recordings"
MOUNT = [-0.153, 0.021, 0.3724]
pytestmark = pytest.mark.slow

Sides = tuple[float, ...]


def edges_off(wanted: dict[int, list[Sides]], found: dict[int, list[Sides]]) -> list[float]:
    """By how many metres each edge of each box is off, where all frames have as many boxes."""
    assert {time: len(boxes) for time, boxes in wanted.items()} == {t: len(b) for t, b in found.items()}
    pairs = [pair for t, boxes in wanted.items() for pair in zip(boxes, found[t], strict=True)]
    return [abs(a - b) for one, other in pairs for a, b in zip(one, other, strict=True)]


def exported_boxes(path: Path) -> dict[int, list[Sides]]:
    """Frame's time, ns -> the team's boxes, millimetres."""
    with AnyReader([path]) as bag:
        of_the_team = [one for one in bag.connections if one.topic == "/midnet/detections"]
        found = [
            (time, boxes_of(bag.deserialize(raw, one.msgtype)))
            for one, time, raw in bag.messages(of_the_team)
        ]
    return {time: sorted(tuple(round(side, 3) for side in box) for box in boxes) for time, boxes in found}


def replayed_boxes(folder: Path) -> dict[int, list[Sides]]:
    found: dict[int, list[Sides]] = defaultdict(list)
    for row in rows(folder / "boxes.csv"):
        sides = tuple(round(float(row[side]), 3) for side in ("x_min_m", "y_min_m", "x_max_m", "y_max_m"))
        found[round(float(row["t"]) * 1e9)].append(sides)
    return {time: sorted(boxes) for time, boxes in found.items()}


@pytest.mark.parametrize(("form", "name"), [("mcap", "trial.mcap"), ("ros1", "trial.bag"), ("ros2", "trial")])
def test_an_exported_trial_gives_its_detections_again(tmp_path: Path, form: str, name: str) -> None:
    trial = "detection --engine fast --robots 2 --frames 8 --seed 7 --set local_map=decay --set decay_s=0.4"
    done = worked("export", *trial.split(), "--format", form, "-o", name, folder=tmp_path)
    (line,) = (line for line in done.stderr.splitlines() if "midnet-bench replay" in line)
    command = line.partition("midnet-bench ")[2].split()
    worked(*command, "-o", "again", folder=tmp_path)
    wanted = exported_boxes(tmp_path / name)
    assert len(wanted) == 8
    assert sum(map(len, wanted.values())) > 8
    wanted = {time: boxes for time, boxes in wanted.items() if boxes}
    # a range of 32 bits puts a return on the edge of a cell into the next one now and then
    off = edges_off(wanted, replayed_boxes(tmp_path / "again"))
    assert sum(metres > 0.001 for metres in off) <= 0.02 * len(off)
    scores = rows(tmp_path / "again" / "recording_scores.csv")
    assert [row["preset"] for row in scores] == ["paper"]
    assert int(scores[0]["labelled"]) == 8


def test_an_exported_trial_is_a_recording_as_any_other(tmp_path: Path) -> None:
    """Its topics alone say where robots, poses and map are; what else is known stands in its setup."""
    worked(
        "export",
        *["detection", "--engine", "fast", "--robots", "2", "--frames", "4", "-o", "t.mcap"],
        folder=tmp_path,
    )
    listed = worked("replay", "t.mcap", folder=tmp_path)
    (proposed,) = (line for line in listed.stderr.splitlines() if line.startswith("proposed: "))
    assert proposed.endswith("replay t.mcap --pose guard_1=tf --pose guard_2=tf --map /map")
    worked(*proposed.removeprefix("proposed: midnet-bench ").split(), "-o", "out", folder=tmp_path)
    assert {row["preset"] for row in rows(tmp_path / "out" / "recording_frames.csv")} == {"real", "paper"}
    assert {path.suffix for path in (tmp_path / "out").iterdir()} == {".csv"}


def played(folder: Path, name: str, *more: object, **keys: object) -> Done:
    if not RECORDINGS.exists():
        pytest.skip("needs ../shared/data/recordings, bags that others recorded and that are no part of this")
    place = RECORDINGS / name
    keys = {"map": str(place / "map.yaml"), "pose": "/ego_pose", "clock": "record", **keys}
    (folder / "setup.yaml").write_text(json.dumps(keys))
    return midnet_bench("replay", place / f"{place.name}.bag", "--setup", "setup.yaml", *more, folder=folder)


@pytest.mark.parametrize(("name", "labels"), [("overtake_red", 130), ("intersection", 24)])
def test_cars_in_a_room_are_found_and_each_error_has_a_cause(tmp_path: Path, name: str, labels: int) -> None:
    truth, has_film = RECORDINGS / name / "truth.csv", name == "intersection"
    options = ("--truth", truth, *(["--film"] if has_film else []), "-o", "out")
    done = played(tmp_path, name, *options, mount=MOUNT, unmapped=has_film)
    assert done.returncode == 0, done.stderr
    assert "scans, poses and map fit" in done.stderr
    assert "ms before it was recorded" in done.stderr
    scores = {row["preset"]: row for row in rows(tmp_path / "out" / "recording_scores.csv")}
    paired = {row["preset"]: row for row in rows(tmp_path / "out" / "recording_matching.csv")}
    assert int(scores["real"]["in_range"]) == labels
    assert float(scores["real"]["recall"]) == 1.0
    assert min(float(scores["real"]["precision"]), float(paired["real"]["precision"])) >= 0.98
    errors = rows(tmp_path / "out" / "errors.csv")
    assert all(row["cause"] for row in errors)
    missed = sum(row["kind"] == "miss" for row in errors if row["preset"] == "paper")
    false = sum(row["kind"] == "false" for row in errors if row["preset"] == "paper")
    assert missed == int(paired["paper"]["missed"])
    assert false == int(scores["paper"]["fp"])
    if has_film:
        assert (tmp_path / "out" / "trial.mp4").stat().st_size > 10_000
        assert (tmp_path / "out" / "storyboard.png").stat().st_size > 10_000
        patched = load_map(tmp_path / "out" / "map_with_unmapped.yaml")
        assert patched.data.shape == load_map(RECORDINGS / name / "map.yaml").data.shape


@pytest.mark.parametrize(
    ("name", "least"),
    [("static_people/neg", 0.0), ("static_people/pos", 0.95), ("static_legs/positive_2", 0.95)],
)
def test_people_are_found_by_a_lidar_at_rest_and_none_in_an_empty_room(
    tmp_path: Path, name: str, least: float
) -> None:
    is_labelled, far = name.startswith("static_legs"), {"obstacle_range_m": 10.0}
    truth = ("--truth", RECORDINGS / name / "truth.csv") if is_labelled else ()
    setup = {"pose": "at:0,0,0", "clock": "header", "preset": "real", "settings": far}
    setup |= {} if is_labelled else {"to_s": 4.0}
    done = played(tmp_path, name, *truth, "-o", "out", **setup)
    assert done.returncode == 0, done.stderr
    (frames,) = rows(tmp_path / "out" / "recording_frames.csv")
    if is_labelled:
        (scores,) = rows(tmp_path / "out" / "recording_scores.csv")
        assert float(scores["recall"]) >= least
    elif least:
        with_a_box = len({row["frame"] for row in rows(tmp_path / "out" / "boxes.csv")})
        assert with_a_box >= least * int(frames["frames"])
    else:
        assert float(frames["boxes_per_frame"]) <= 0.03


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({}, "mount: [-0.1"),
        ({"mount": MOUNT, "mirrored": True}, "the scans are mirrored: mirrored: false"),
        ({"mount": [-0.153, 0.021, 180.37]}, "the scans are turned by 180 degrees"),
    ],
)
def test_a_wrong_setup_is_named_before_any_score(tmp_path: Path, keys: dict[str, object], said: str) -> None:
    done = played(tmp_path, "overtake_red", "--preset", "real", "-o", "out", to_s=3.0, **keys)
    assert done.returncode == 2
    first = next(line for line in done.stderr.splitlines() if line.startswith("does not fit: "))
    assert said in first
    assert (tmp_path / "out" / "boxes.csv").exists()


def test_a_check_finds_the_mount(tmp_path: Path) -> None:
    done = played(tmp_path, "intersection", "--check", "--json")
    assert done.returncode == 0, done.stderr
    (table,) = json.loads(done.stdout)["tables"].values()
    found = {row["parameter"]: row["value"] for row in table}
    assert abs(found["mount x"] + 0.153) < 0.03
    assert abs(found["mount y"] - 0.021) < 0.03
    assert abs(found["mount yaw"] - 0.372) < 1.0
    written = tmp_path / "results" / "replay-intersection" / "setup.yaml"
    setup = RecordingSetup.load(written)
    assert setup.mount[EVERY] == pytest.approx(
        (found["mount x"], found["mount y"], found["mount yaw"]), abs=0.01
    )
    assert (setup.scan, setup.pose, setup.clock) == ({EVERY: "/scan"}, {EVERY: "/ego_pose"}, "record")
    assert Path(setup.map or "").resolve() == (RECORDINGS / "intersection" / "map.yaml").resolve()
    # what a user has changed there is kept
    written.write_text("clock: header\n")
    assert played(tmp_path, "intersection", "--check").returncode == 0
    assert written.with_name("setup.yaml.old").read_text() == "clock: header\n"
    assert RecordingSetup.load(written) == setup


def test_a_declared_ally_is_no_intruder(tmp_path: Path) -> None:
    allies = {"red": {"topic": "/red_pose"}}
    done = played(tmp_path, "overtake_red", "--preset", "real", "-o", "out", mount=MOUNT, allies=allies)
    assert done.returncode == 0, done.stderr
    frames = {row["frame"] for row in rows(tmp_path / "out" / "boxes.csv")}
    assert len(frames) <= 1


def test_a_laser_at_rest_makes_its_own_map(tmp_path: Path) -> None:
    """A square room; after six seconds a box stands two metres ahead."""
    angles = [math.radians(k) for k in range(360)]
    walls = [2.5 / max(abs(math.cos(angle)), abs(math.sin(angle))) for angle in angles]
    lines = ["t,angle_min,angle_increment,range_min,range_max," + ",".join(f"r{k}" for k in range(360))]
    for tenth in range(100):
        ranges = [2.0 if tenth >= 60 and k in range(5) else walls[k] for k in range(360)]
        lines.append(",".join(map(str, (0.1 * tenth, 0.0, math.radians(1.0), 0.1, 8.0, *ranges))))
    (tmp_path / "still.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "setup.yaml").write_text("background: first-5\npose: at:0,0,0\n")
    options = ("--setup", "setup.yaml", "--preset", "real", "-o", "out")
    worked("replay", "still.csv", *options, folder=tmp_path)
    boxes = rows(tmp_path / "out" / "boxes.csv")
    assert len(boxes) == 40
    assert {round(float(row["t"])) for row in boxes} == {6, 7, 8, 9, 10}
    assert all(abs(float(row["x_min_m"]) - 1.9) < 0.11 for row in boxes)
    assert {row["cause"] for row in rows(tmp_path / "out" / "errors.csv")} <= {"unlabelled", "unmapped"}


def test_wrong_keys_of_a_setup_are_named_where_they_were_typed(tmp_path: Path) -> None:
    trial = "detection --engine fast --robots 2 --frames 2 -o t.mcap"
    worked("export", *trial.split(), folder=tmp_path)
    setup = tmp_path / "setup.yaml"
    for text, said in {
        "pose: nope": "setup.yaml: pose: no topic 'nope'",
        "scan: [/guard_1/scan, /guard_1/scan]": "setup.yaml: scan: a topic is there twice",
        "settings: {thresh_local: 0}": "setup.yaml: settings: thresh_local: must be at least 1 (got 0)",
        "settings: {detector: clusters(noise_m=-1)}": "setup.yaml: settings: detector: clusters(noise_m=-1)",
    }.items():
        setup.write_text(f"map: /map\n{text}\n")
        assert said in one_line_of_complaint(
            midnet_bench("replay", "t.mcap", "--setup", setup, folder=tmp_path)
        )
    for words, said in {
        ("--pose", "nobody=tf"): "--pose: nobody: no robot is called 'nobody'",
        ("--set", "thresh_local=0"): "--set thresh_local: must be at least 1 (got 0)",
        ("--set", "resolution_m=1"): "--set resolution_m: 1: cells are as large as the map's, 0.05 m",
        ("t.mcap",): "t.mcap: is given twice",
    }.items():
        line = ("replay", "t.mcap", "--map", "/map", *words)
        assert said in one_line_of_complaint(midnet_bench(*line, folder=tmp_path))
