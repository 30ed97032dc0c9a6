"""What a recording from elsewhere must not do: run code, take all memory, wait for ever, end in a trace."""

import json
from pathlib import Path

import pytest

from midnet_bench.recording.files.ros_messages import Message
from tests.cli.command import Done, midnet_bench, one_line_of_complaint
from tests.recording import recordings as made
from tests.recording.recordings import Drive, Said

DRIVE = Drive(seconds=1.5, lidar=made.lidar_of(60))
SAYS = {
    "rate_hz": 5.0,
    "tick_hz": 30.0,
    "settings": {},
    "robots": [{"name": "robot", "scan": "/scan", "pose": "/pose", "mount": [0.1, 0.02, 0.05]}],
}


def bag_that_says(folder: Path, said: object, name: str = "b") -> Path:
    """A recording with a map and settings of its own; ``said``: JSON as text, or what is put into it."""
    text = said if isinstance(said, str) else json.dumps(said)
    own = Said("/midnet/replay", made.ns_of(0.0), Message("std_msgs/msg/String", {"data": text}), True)
    messages = [own, made.map_message(), *made.scan_messages(DRIVE), *made.pose_messages(DRIVE)]
    return made.write_bag(folder, messages, name=name)


def replayed(bag: Path, *arguments: object) -> Done:
    return midnet_bench("replay", bag, "--map", "/map", "-o", "out", *arguments, folder=bag.parent)


@pytest.mark.parametrize("option", ["detector", "fusion", "robot"])
@pytest.mark.parametrize("place", ["evil.py:X", "FOLDER/evil.py:X", "evilmodule:X", "evil.py:X#0123456789ab"])
def test_a_recording_runs_no_code(
    option: str, place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("evil.py", "evilmodule.py"):
        (tmp_path / name).write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\nclass X: pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    named = place.replace("FOLDER", str(tmp_path))
    bag = bag_that_says(tmp_path, {**SAYS, "settings": {option: named}})
    line = one_line_of_complaint(replayed(bag))
    assert f"--set {option}=" in line
    assert "b.mcap" in line
    proposed = midnet_bench("replay", bag, folder=tmp_path)
    assert proposed.returncode == 0
    assert "evil" not in proposed.stdout + proposed.stderr
    assert not (tmp_path / "ran").exists()


def test_what_the_user_types_counts_more_than_the_recording(tmp_path: Path) -> None:
    (tmp_path / "evil.py").write_text("open('ran', 'w')\nclass X: pass\n")
    bag = bag_that_says(tmp_path, {**SAYS, "settings": {"detector": "evil.py:X", "thresh_local": 40}})
    done = replayed(bag, "--set", "detector=clusters")
    assert done.returncode == 0, done.stderr
    assert not (tmp_path / "ran").exists()
    own = bag_that_says(tmp_path, {**SAYS, "settings": {"detector": "clusters(noise_m=0.02)"}}, "own")
    assert replayed(own).returncode == 0


@pytest.mark.parametrize(
    "said",
    [
        "[" * 200_000,
        '{"a":' * 200_000,
        {**SAYS, "tick_hz": 1e308},
        {**SAYS, "rate_hz": 1e308},
        {**SAYS, "robots": [{**SAYS["robots"][0], "mount": [0, 0, 10**400]}]},  # type: ignore[index]
        {**SAYS, "settings": {"detector": ["evil.py:X"]}},
        {**SAYS, "settings": {"detector": 3, "fusion": None}},
        {**SAYS, "settings": {"\x1b]0;": "\x1b[2J"}},
    ],
    ids=range(8),
)
def test_what_a_recording_says_of_itself_and_cannot_be_is_a_line(said: object, tmp_path: Path) -> None:
    bag = bag_that_says(tmp_path, said)
    assert "b.mcap: /midnet/replay" in one_line_of_complaint(replayed(bag))
