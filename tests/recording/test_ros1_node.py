"""``node --ros 1`` on a real ROS 1: a master, ``rosbag play`` and ``rosbag record`` of Debian's packages."""

import contextlib
import importlib.util
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
import xmlrpc.client
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from midnet_bench.campaign.trial import Scalar
from midnet_bench.geometry import Box
from midnet_bench.recording.live import LiveNode, LiveOptions
from midnet_bench.recording.ros_node import DEBIANS, PUBLISHED
from midnet_bench.recording.setup import ReplaySettings
from midnet_bench.workflows.export import export_trial
from tests.cli.command import REPOSITORY, in_its_own_process, midnet_bench, one_line_of_complaint
from tests.recording.test_export import read, stamp_of, trials_own

FRAMES, SEED = 30, 3
TEAM: dict[str, Scalar] = {"robots": 5, "frames": FRAMES, "engine": "fast"}
NAMES = [f"guard_{number}" for number in range(1, 6)]
NS = 1_000_000_000
PATIENCE_S = 30.0  # until a program of ROS must have answered

HAS_ROSPY = importlib.util.find_spec("rospy") is not None or (Path(DEBIANS) / "rospy").is_dir()
MISSING = [name for name in ("roscore", "rosbag") if shutil.which(name) is None]
MISSING += [] if HAS_ROSPY else ["rospy"]
needs_ros = pytest.mark.skipif(
    bool(MISSING), reason=f"no {', '.join(MISSING)}: apt install ros-core python3-rospy"
)


class Ros:
    """A master of its own on this machine, and programs that know it."""

    def __init__(self, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.folder = folder
        self.uri = f"http://127.0.0.1:{self.port}"
        self.environment = {
            **os.environ,
            "ROS_MASTER_URI": self.uri,
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(folder),
            "PYTHONPATH": str(REPOSITORY),
        }
        self.running = contextlib.ExitStack()

    def start(self, *command: str) -> subprocess.Popen[bytes]:
        """A program, with all that it says in a file; it is ended with the test."""
        log = self.running.enter_context((self.folder / f"{Path(command[0]).name}.log").open("ab"))
        # the tools of ROS run by Debian's Python, which is to see nothing of this one's
        environment = {k: v for k, v in self.environment.items() if k != "PYTHONPATH"}
        started = subprocess.Popen(
            command,
            stdout=log,
            stderr=log,
            cwd=self.folder,
            env=self.environment if command[0] == sys.executable else environment,
            start_new_session=True,
        )
        self.running.callback(self.stop, started)
        return started

    def stop(self, program: subprocess.Popen[bytes]) -> int:
        """Its exit code after Ctrl-C."""
        if program.poll() is None:
            os.killpg(program.pid, signal.SIGINT)
        try:
            return program.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(program.pid, signal.SIGKILL)
            return program.wait()

    def subscribers(self) -> dict[str, list[str]]:
        """Topic -> who listens to it; nothing as long as no master answers."""
        try:
            with xmlrpc.client.ServerProxy(self.uri) as master:
                _, _, state = master.getSystemState("/test")  # type: ignore[misc]
        except OSError:
            return {}
        return dict(state[1])  # type: ignore[index,call-overload]

    def said(self) -> str:
        """All logs."""
        return "\n".join(
            f"{log.name}: {log.read_text(errors='replace')}" for log in sorted(self.folder.glob("*.log"))
        )

    def wait_for(self, what: Callable[[], bool], in_words: str) -> None:
        """Fails with the logs if it takes too long."""
        end_s = time.monotonic() + PATIENCE_S
        while not what():
            assert time.monotonic() < end_s, f"{in_words}\n{self.said()}"
            time.sleep(0.05)


@pytest.fixture
def ros(tmp_path: Path) -> Iterator[Ros]:
    made = Ros(tmp_path)
    with made.running:
        made.start("roscore", "-p", str(made.port))
        made.wait_for(lambda: "/rosout" in made.subscribers(), "no master")
        yield made


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("exported") / "trial.bag"
    export_trial("detection", TEAM, SEED, path, "ros1")
    return path


def offline(trial: Path, pose_by_tf: bool) -> dict[int, list[Box]]:
    """Stamp -> boxes of the same messages in the order of the bag, without ROS."""
    chosen = LiveOptions(NAMES, lambda resolution_m: ReplaySettings.of("paper", {}, resolution_m), pose_by_tf)
    topics, node = chosen.topics(needs_map=True), LiveNode(chosen, None)
    return {
        found.stamp_ns: found.boxes
        for one in read(trial)
        if one.topic in topics
        for found in node.hear(one.topic, one.message, 0.0)
    }


@needs_ros
@pytest.mark.slow
@pytest.mark.parametrize("pose", ["topic", "tf"])
def test_a_played_trial_gives_the_detections_of_the_same_messages_offline(
    ros: Ros, trial: Path, pose: str
) -> None:
    # under tf the scans of one robot have another name on the wire, as on a robot of somebody else's
    renamed = ["/guard_1/scan:=/front/scan"] if pose == "tf" else []
    options = f"--ros 1 --preset paper --pose {pose} --patience 20".split()
    node = ros.start(sys.executable, "-m", "midnet_bench", "node", *NAMES, *renamed, *options)
    recorder = ros.start("rosbag", "record", "-O", "heard.bag", PUBLISHED)
    heard = (PUBLISHED, "/map", "/guard_5/scan", "/tf" if pose == "tf" else "/guard_5/pose")
    ros.wait_for(lambda: heard_by(ros).issuperset(heard), "the node and the recorder do not listen")
    # what the trial's own detector said goes elsewhere
    elsewhere = f"{PUBLISHED}:=/trial/detections"
    played = ros.start("rosbag", "play", "--rate", "4", "--delay", "1", str(trial), elsewhere, *renamed)
    assert played.wait(PATIENCE_S) == 0, ros.said()
    wanted = offline(trial, pose == "tf")
    recorded = ros.folder / "heard.bag.active"
    ros.wait_for(lambda: "midnet" in ros.said() and recorded.exists(), "nothing is recorded")
    time.sleep(2.0)  # what was sent is on its way
    assert ros.stop(node) == 0, ros.said()
    ros.stop(recorder)
    # who writes the bag outlives who was asked to
    ros.wait_for((ros.folder / "heard.bag").exists, "the recorder closes no bag")
    found = {one.stamp_ns: one for one in read(ros.folder / "heard.bag")}
    stamps = {stamp_of(one.message.markers[0].header): one.message.markers[1:] for one in found.values()}
    assert stamps.keys() == wanted.keys()
    assert len(wanted) == FRAMES - 1
    assert sum(map(len, wanted.values())) > FRAMES
    for stamp_ns, boxes in wanted.items():
        markers = stamps[stamp_ns]
        assert [(one.pose.position.x, one.pose.position.y, one.scale.x, one.scale.y) for one in markers] == [
            (*box.center, box.x_max - box.x_min, box.y_max - box.y_min) for box in boxes
        ]
    own = trials_own(TEAM, SEED)
    same = sum(boxes == own[stamp_ns * 5 // NS - 1] for stamp_ns, boxes in wanted.items())
    print(f"{same} of {len(wanted)} frames are those of the trial, which has 64 bits of a range")
    assert same >= 0.8 * FRAMES


def heard_by(ros: Ros) -> set[str]:
    return {
        topic
        for topic, names in ros.subscribers().items()
        if "/midnet" in names or any(name.startswith("/record") for name in names)
    }


@needs_ros
def test_without_a_master_a_line_says_so(tmp_path: Path) -> None:
    nowhere = {"ROS_MASTER_URI": "http://127.0.0.1:9"}
    done = in_its_own_process("node", "--ros", "1", "guard_1", folder=tmp_path, environment=nowhere)
    assert (done.returncode, done.stdout) == (2, "")
    assert "start roscore" in done.stderr


def test_without_rospy_a_line_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("midnet_bench.recording.ros_node.DEBIANS", str(tmp_path))
    monkeypatch.setitem(sys.modules, "rospy", None)
    assert "python3-rospy" in one_line_of_complaint(
        midnet_bench("node", "--ros", "1", "guard_1", folder=tmp_path)
    )


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("guard_1", "--pose", "odom"), "odom"),
        (("guard_1", "--mount", "1,2"), "--mount"),
        (("guard_1", "--rate", "0"), "--rate"),
        (("guard_1", "guard_1"), "twice"),
        (("guard_1", "--set", "thresh_locl=3"), "thresh_local"),
        (("guard_1", "--map", "none.yaml"), "none.yaml"),
        (("/scan:=/front",), "NAME"),
    ],
)
def test_what_cannot_be_is_one_line(arguments: tuple[object, ...], named: str, tmp_path: Path) -> None:
    assert named in one_line_of_complaint(midnet_bench("node", *arguments, folder=tmp_path))
