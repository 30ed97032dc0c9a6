"""``node --ros 2`` over DDS on this machine's loopback, in two processes; rclpy itself is not run."""

import importlib.util
import os
import pickle
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from rosbags.rosbag1 import Writer

from midnet_bench.recording.files.writer import Types
from midnet_bench.recording.live import LiveNode
from tests.cli.command import REPOSITORY, in_its_own_process, midnet_bench, one_line_of_complaint
from tests.recording.test_export import stamp_of
from tests.recording.test_node_attacks import NAMES, NS, OPTIONS, Raw, drive, with_malformed

needs_dds = pytest.mark.skipif(
    importlib.util.find_spec("cyclonedds") is None, reason="no cyclonedds: pip install 'midnet-bench[ros2]'"
)
ROS1, TYPES = Types(1), Types(2)
CORNERS = ["x_min_m", "y_min_m", "x_max_m", "y_max_m"]
KIND = "visualization_msgs/msg/MarkerArray"
PLAYER = Path(__file__).with_name("dds_player.py")


def cdr(one: Raw) -> bytes:
    """The bytes in ROS 2's packing; of bytes that are no message themselves, behind a header."""
    try:
        return bytes(TYPES.store.serialize_cdr(one.message, one.kind))
    except Exception:
        return b"\0\1\0\0" + one.data


def frames_of(sound: list[Raw]) -> dict[int, list[tuple[float, ...]]]:
    """Stamp -> boxes of the node's own class, without a middleware."""
    node = LiveNode(OPTIONS, None)
    return {
        found.stamp_ns: [(*box.center, box.x_max - box.x_min, box.y_max - box.y_min) for box in found.boxes]
        for one in sound
        for found in node.hear(one.topic, one.message, 0.0)
    }


def played(
    folder: Path, messages: list[Raw], sound: list[Raw], *arguments: str, **renamed: str
) -> tuple[int, dict[int, list[tuple[float, ...]]]]:
    """How many malformed messages DDS let pass, and stamp -> boxes that a node's process publishes.

    Another process plays the messages; the map and what is static are there before the node.
    """
    kinds = OPTIONS.topics(needs_map=True)
    first_ns, are_sound = messages[0].arrived_ns, set(map(id, sound))
    source, sink = folder / "messages.pickle", folder / "heard.pickle"
    said = [
        (
            renamed.get(one.topic, one.topic),
            kinds[one.topic],
            (one.arrived_ns - first_ns) / NS,
            cdr(one),
            id(one) in are_sound,
        )
        for one in messages
    ]
    source.write_bytes(pickle.dumps(said))
    command = [sys.executable, "-m", "midnet_bench", "node", "--ros", "2", *NAMES]
    command += ["--preset", "paper", "--patience", "30", *arguments]
    log, alone = folder / "node.log", {**os.environ, "ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}
    with log.open("wb") as to_log:
        # a shell's background job ignores Ctrl-C, and so would the node
        heeds = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
        node = subprocess.Popen(
            command, stdout=to_log, stderr=to_log, cwd=REPOSITORY, env=alone, preexec_fn=heeds
        )
        try:
            player = [sys.executable, str(PLAYER), str(source), str(sink), str(len(frames_of(sound)))]
            done = subprocess.run(
                player,
                cwd=REPOSITORY,
                env={**alone, "PYTHONPATH": str(REPOSITORY)},
                capture_output=True,
                text=True,
                timeout=300,
            )
            assert done.returncode == 0, done.stderr + log.read_text()
            assert node.poll() is None, log.read_text()
        finally:
            node.send_signal(signal.SIGINT)
            try:
                assert node.wait(30) == 0, log.read_text()
            finally:
                node.kill()
                node.wait()
    came, sent = pickle.loads(sink.read_bytes())
    found = [TYPES.store.deserialize_cdr(raw, KIND).markers for raw in came]
    return sent, {
        stamp_of(markers[0].header): [
            (one.pose.position.x, one.pose.position.y, one.scale.x, one.scale.y) for one in markers[1:]
        ]
        for markers in found
    }


def replayed(folder: Path, sound: list[Raw]) -> dict[int, object]:
    """Stamp -> boxes, to 0.1 mm, that ``replay`` finds in a bag of the same messages."""
    bag, connections = folder / "drive.bag", dict[str, Any]()
    with Writer(bag) as writer:
        for one in sound:
            if one.topic not in connections:
                connections[one.topic] = writer.add_connection(one.topic, one.kind, typestore=ROS1.store)
            writer.write(connections[one.topic], one.arrived_ns, one.data)
    poses = ", ".join(f"{name}: /{name}/pose" for name in NAMES)
    setup = folder / "setup.yaml"
    setup.write_text(f"rate_hz: 5\npreset: paper\nmap: /map\npose: {{{poses}}}\n")
    done = midnet_bench("replay", bag, "--setup", setup, "-o", folder / "out", folder=folder)
    assert done.returncode == 0, done.stderr
    table = pd.read_csv(folder / "out" / "boxes.csv")
    return {
        round(time_s * NS): np.sort(boxes[CORNERS].to_numpy(), axis=0).tolist()
        for time_s, boxes in table.groupby("t")
    }


def corners(boxes: list[tuple[float, ...]]) -> list[list[float]]:
    """The corners of boxes as :func:`replayed` has them."""
    low_high = [(x - w / 2, y - h / 2, x + w / 2, y + h / 2) for x, y, w, h in boxes]
    return (np.sort(np.array(low_high).round(4), axis=0) + 0.0).tolist()


@needs_dds
@pytest.mark.slow
def test_frames_over_dds_are_those_of_replay_in_spite_of_malformed_messages(tmp_path: Path) -> None:
    sound = drive(20)
    wanted = frames_of(sound)
    assert len(wanted) == 19
    assert sum(map(len, wanted.values())) > 19
    renamed = {"/guard_1/scan": "/front/scan"}
    names = [f"{old}:={new}" for old, new in renamed.items()]
    sent, found = played(tmp_path, list(with_malformed(sound, 180)), sound, *names, **renamed)
    assert sent >= 75
    assert found == wanted
    lines = (tmp_path / "node.log").read_text().splitlines()
    assert 1 < len(lines) < 30
    of_replay = replayed(tmp_path, sound)
    assert {stamp_ns: corners(boxes) for stamp_ns, boxes in found.items()} == {
        stamp_ns: of_replay[stamp_ns] for stamp_ns in wanted
    }


@needs_dds
@pytest.mark.parametrize(
    ("words", "domain", "named"),
    [(["/scan:="], "0", "/scan:="), ([], "-1", "ROS_DOMAIN_ID"), ([], "233", "_ID")],
)
def test_what_cannot_be_is_one_line(
    words: list[str], domain: str, named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", domain)
    done = midnet_bench("node", "--ros", "2", "guard_1", *words, folder=tmp_path)
    assert named in one_line_of_complaint(done)


@needs_dds
@pytest.mark.slow
def test_a_dds_that_cannot_start_is_one_line(tmp_path: Path) -> None:
    wrong = {"CYCLONEDDS_URI": "<CycloneDDS><Nonsense/></CycloneDDS>"}
    done = in_its_own_process("node", "--ros", "2", "guard_1", folder=tmp_path, environment=wrong)
    assert (done.returncode, done.stdout) == (2, "")
    assert "DDS cannot start" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr


def test_without_rclpy_and_cyclonedds_a_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    monkeypatch.setitem(sys.modules, "cyclonedds.core", None)
    assert "midnet-bench[ros2]" in one_line_of_complaint(midnet_bench("node", "guard_1", folder=tmp_path))
