"""Which files of the package a reader opens to follow a frame, a control cycle and a command."""

from importlib.util import find_spec

import pytest

from benchmarks.files_opened import WORLD, command, control_cycle, midnet_frame


@pytest.mark.slow
def test_a_frame_and_a_control_cycle_are_traced_from_end_to_end() -> None:
    """A robot's cycle enters no detector, a frame no planner, and each enters both ends of its own way."""
    frame, cycle = midnet_frame(), control_cycle()
    assert {"simulation/sensors.py", "midnet/pipeline.py", "scoring/frame_counts.py"} <= frame
    assert {"localization/ukf.py", "navigation/costmap.py", "navigation/dwa.py"} <= cycle
    assert not {name for name in frame if "planner" in name or "dwa" in name}
    assert not {name for name in cycle if name.startswith(("midnet/", "scoring/", "detectors/"))}
    assert {name for name in cycle if name.startswith(WORLD)}


@pytest.mark.slow
@pytest.mark.skipif(find_spec("pybullet") is None, reason="the figure is of PyBullet's engine")
def test_a_command_is_traced_from_the_command_line_to_the_report_and_not_into_the_trial() -> None:
    files = command()
    assert {"cli/app.py", "campaign/store.py", "workflows/report.py", "page/page.py"} <= files
    assert not {name for name in files if name.startswith(("midnet/", "navigation/dwa", "simulation/bullet"))}
