"""``export`` on the command line: which trial it is, where it goes, and what is refused."""

from pathlib import Path

import pytest

from tests.cli.command import midnet_bench, one_line_of_complaint, unpainted, worked
from tests.recording.test_export import read

SMALL = ("--engine", "fast", "--set", "frames=2")


@pytest.mark.slow
def test_a_trial_goes_to_a_file_that_is_named(tmp_path: Path) -> None:
    done = worked("export", "detection", *SMALL, "--robots", 1, "--seed", 4, folder=tmp_path)
    assert done.stdout == "results/export-detection-4.mcap\n"
    said = list(read(tmp_path / done.stdout.strip()))
    assert sum(one.topic == "/midnet/detections" for one in said) == 2
    assert not any(one.topic.startswith("/guard_2") for one in said)


@pytest.mark.slow
def test_a_campaigns_trial_is_written_as_it_was(tmp_path: Path) -> None:
    campaign = ("detection", *SMALL, "--robots", "1,2", "--seeds", 2, "-o", "campaign", "--record")
    with unpainted():
        worked(*campaign, folder=tmp_path)
    named = ("--seed", 2, "--robots", 2, "--format", "ros1", "-o", "trial.bag")
    worked("export", "campaign", *named, folder=tmp_path)
    again = ("--seed", 2, "--robots", 2, "--format", "ros2", "-o", "again")
    worked("export", "detection", *SMALL, *again, folder=tmp_path)
    of_campaign, of_experiment = (
        [
            (one.stamp_ns, [(cube.pose.position.x, cube.pose.position.y) for cube in one.message.markers])
            for one in read(tmp_path / name)
            if one.topic in ("/midnet/detections", "/guard_2/boxes")
        ]
        for name in ("trial.bag", "again")
    )
    assert of_campaign == of_experiment
    for arguments, named_too in [
        (("--robots", 2), "--seed"),
        (("--seed", 2), "robots"),
        (("--seed", 3, "--robots", 2), "seed: 3"),
        (("--seed", 2, "--robots", 3), "robots=3"),
        (("--seed", 2, "--robots", 2, "--frames", 3), "--frames"),
    ]:
        complaint = one_line_of_complaint(midnet_bench("export", "campaign", *arguments, folder=tmp_path))
        assert named_too in complaint
