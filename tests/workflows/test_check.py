"""``check`` names what is wrong with each of many broken parts, and passes those of the package."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from midnet_bench.errors import InputError
from midnet_bench.plugins import ExtensionPoint
from midnet_bench.robots.model import ROBOTS
from midnet_bench.simulation.engine import SIMULATORS
from midnet_bench.workflows.check import (
    CHASE,
    EVERY,
    PLUGINS,
    ROWS,
    SHORT,
    Checked,
    Row,
    check,
    recorded,
)
from tests.cli.command import midnet_bench, one_line_of_complaint
from tests.simulation.scenes import OWN_ENGINE, OWN_ROBOT

DETECTOR = """
import itertools, os, random, time
import numpy as np
from midnet_bench.detectors.baselines import MapSubtraction

class Mine(MapSubtraction):
    seen = itertools.count()
    def __init__(self, prior_map, range_m):
        super().__init__(prior_map, range_m)
    def detect(self, team):
        {}
"""
OF_BOXES = {
    "global random numbers": "boxes + np.random.uniform(0, 0.1)",
    "it answers otherwise the second time": "boxes + 0.001 * next(Mine.seen)",
    "another process gets other results": "boxes + 1e-9 * os.getpid()",
    "are these metres?": "1000 * boxes",
    "is it in the map frame?": "boxes + 30.0",
    "shape (": "boxes[:, :2]",
    "is not finite": "boxes * np.nan",
    "without area": "boxes[:, [2, 3, 0, 1]]",
}
"""what a broken detector makes of each robot's boxes"""
BROKEN = {
    **{fault: f"return [{code} for boxes in super().detect(team)]" for fault, code in OF_BOXES.items()},
    "changes what it is given": "for robot in team: robot.costmap.data[:] = 0",
    "with nobody: ": "return super().detect([team[0], *team[1:]])",
    "with one robot that has seen nothing: ": "return super().detect([r for r in team if r.scan.stamp_s])",
    "with 20 robots: ": "return super().detect(team)[:9]",
    "ZeroDivisionError: division by zero": "1 / 0",
    "gave no numbers": "return [['a box'] for _ in team]",
    "0 lists of boxes for": "return []",
}
"""what ``detect`` of a broken detector does"""
CHASES = {
    "pursue gave list; give a dict": "[0]",
    "a target 99; there are": "{0: 99}",
    "a guard 1; there are 0 to 0": "{1: min(targets)}",
    "it answers otherwise the second time": "{0: sorted(targets)[next(Mine.seen) % 5 % len(targets)]}",
    "global random numbers": "{0: random.choice(sorted(targets))}",
    "another process gets other results": "{0: min(targets)} if 'pytest' in sys.modules else {}",
    "TypeError": "{0: min(targets, key=lambda target: self.gap)}",
}
"""what ``pursue`` of a broken pursuit gives"""
MEASURES = {
    "frame gave NoneType; give a dict": "None",
    "the name 'Boxes per frame'; small letters": "{'Boxes per frame': len(seen.boxes)}",
    "a finite number is needed": "{'iou': 0.0 / len(seen.boxes) if len(seen.boxes) else float('nan')}",
    "assignment destination is read-only": "seen.boxes.__setitem__(0, 0.0)",
    "it answers otherwise the second time": "{'calls': next(Mine.seen)}",
    "global random numbers": "{'luck': random.random()}",
    "with no intruders: ": "{'first': float(seen.truths[0].name != '')}",
}
"""what ``frame`` of a broken metric gives"""


@pytest.fixture(autouse=True, scope="module")
def _shorter_trials() -> Iterator[None]:
    """What is wrong shows in the first frames."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("midnet_bench.workflows.check.FRAMES", 7)
        for values in (SHORT, CHASE):
            for name, value in {"frames": 2, "robots": 1, "time_limit_s": 3.0}.items():
                if name in values:
                    patched.setitem(values, name, value)  # type: ignore[arg-type]
        recorded.cache_clear()
        yield
        recorded.cache_clear()


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


PURSUIT = (
    "import itertools, random, sys\n"
    "class Mine:\n    seen = itertools.count()\n    gap = {{}}\n"
    "    def __init__(self, prior_map, rng): pass\n"
    "    def pursue(self, team, targets, time_s): return {}\n"
)
METRIC = (
    "import itertools, random\nclass Mine:\n    seen = itertools.count()\n"
    "    def frame(self, seen): return {}\n"
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "template", "fault", "code"),
    [("detector", DETECTOR, *one) for one in BROKEN.items()]
    + [("pursuit", PURSUIT, *one) for one in CHASES.items()]
    + [("metrics", METRIC, *one) for one in MEASURES.items()],
)
def test_the_fault_of_a_broken_plug_in_is_found(
    option: str, template: str, fault: str, code: str, folder: Path, request: pytest.FixtureRequest
) -> None:
    if "process" not in fault:
        request.getfixturevalue("trials_in_this_process")
    (folder / "mine.py").write_text(template.format(code))
    found = check("mine.py:Mine")
    assert found.option == option
    assert any(fault in one for one in found.faults), found.faults
    assert all("\n" not in one for one in found.faults)
    if "process" not in found.faults[0]:
        assert all("mine.py:" in one.replace("mine.py:Mine", "") for one in found.faults), found.faults


def faults_without_trials(point: ExtensionPoint, name: str) -> list[str]:
    """By the rows that ask things of plug-ins of this extension point alone."""
    (plugin,) = (plugin for plugin in PLUGINS if plugin.point is point)
    own_rows: list[Row] = [row for row in ROWS if point in row.of and row.of != EVERY]
    return [fault for row in own_rows for fault in row.faults(Checked(plugin, name))]


@pytest.mark.parametrize(
    ("right", "wrong", "fault"),
    [
        ("", "", None),
        ("rims * self.step_s", "0.5 * rims * self.step_s", "wheel_angles: wheels rolled"),
        ("self.commands[index] = command", "pass", "drive: told 0.18 m/s"),
        ("np.where(meets, along, ", "np.where(meets, 0.9 * along + 0.1 * far_m, ", "cast: "),
        (
            "layout.robots + layout.intruders)",
            "layout.robots + layout.intruders) + 0.1",
            "poses: robots do not",
        ),
        ("way = ", "way = np.random.rand() * ", "two worlds that were made and driven alike differ"),
    ],
)
def test_the_fault_of_an_engine_is_found(right: str, wrong: str, fault: str | None, folder: Path) -> None:
    (folder / "stub.py").write_text(OWN_ENGINE.replace(right, wrong))
    name = SIMULATORS.pinned("stub.py:World")
    faults = faults_without_trials(SIMULATORS, name)
    assert faults == [] if fault is None else any(fault in one for one in faults), faults


@pytest.mark.slow
def test_a_robot_is_driven_on_both_engines(folder: Path) -> None:
    (folder / "mine.py").write_text(OWN_ROBOT)
    assert faults_without_trials(ROBOTS, ROBOTS.pinned("mine.py:ROBOT")) == []
    weak = faults_without_trials(ROBOTS, ROBOTS.pinned("mine.py:ROBOT(rim_acceleration_mps2=0.01)"))
    assert any(one.startswith("on fast: drive: told 0.24 m/s") for one in weak), weak


@pytest.mark.slow
def test_a_good_detector_of_ones_own_is_ok_and_a_broken_one_has_exit_code_one(folder: Path) -> None:
    (folder / "mine.py").write_text(DETECTOR.format("return super().detect(team)"))
    done = midnet_bench("check", "mine.py:Mine", folder=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("ok, ")
    assert "ms a frame (detector mine.py:Mine#" in done.stdout
    (folder / "mine.py").write_text(DETECTOR.format("1 / 0"))
    done = midnet_bench("check", "mine.py:Mine", folder=folder)
    assert done.returncode == 1
    assert "ZeroDivisionError: division by zero" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", dict.fromkeys(name for plugin in PLUGINS for name in plugin.point.own))
def test_what_comes_with_the_package_is_ok(name: str) -> None:
    for plugin in PLUGINS:
        if library := plugin.point.needs.get(name):
            pytest.importorskip(library, reason=f"the extra midnet-bench[{name}] is not installed")
    assert check(name).faults == []


@pytest.mark.slow
def test_the_method_says_that_a_class_is_a_fusion(folder: Path) -> None:
    (folder / "mine.py").write_text(
        "class First:\n    def fuse(self, found, time_s):\n        return found[0]\n"
    )
    found = check("mine.py:First")
    assert found.option == "fusion"
    assert any(one.startswith("with nobody: fusion mine.py:First") for one in found.faults)


@pytest.mark.slow
def test_a_patrol_that_sends_guards_through_walls_is_found(folder: Path) -> None:
    (folder / "mine.py").write_text(
        "class Away:\n    def __init__(self, points, guards, rng):\n        pass\n"
        "    def next_point(self, guard, team, time_s):\n        return 100.0, guard\n"
    )
    found = check("mine.py:Away")
    assert found.option == "patrol"
    (fault,) = found.faults
    assert fault.startswith("mine.py:4: (100, ")
    assert fault.endswith(" m: return one of the points that the constructor got")


def test_what_is_for_no_extension_point_is_one_line(folder: Path) -> None:
    complaint = one_line_of_complaint(midnet_bench("check", "os:sep", folder=folder))
    assert "expected a class with a method 'detect', or a function" in complaint
    with pytest.raises(InputError, match="unknown name 'nix'"):
        check("nix")


@pytest.mark.slow
def test_one_that_ends_its_process_is_found(folder: Path) -> None:
    (folder / "mine.py").write_text(DETECTOR.format("os._exit(3)"))
    assert any("its worker died twice" in fault for fault in check("mine.py:Mine").faults)
