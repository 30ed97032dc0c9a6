"""From a map, poses and scans to boxes, where neither simulator nor arena nor agents can be imported."""

import math
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from midnet_bench.detectors.detector_node import DetectorNode
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.geometry import LidarGeometry, Pose2D
from midnet_bench.grid import OccupancyGrid


@pytest.mark.slow
def test_the_node_needs_no_simulator_no_arena_and_no_agents() -> None:
    program = """
import sys
for room in ("simulation", "arena", "agents", "campaign"):
    sys.modules[f"midnet_bench.{room}"] = None
sys.modules["pybullet"] = None
import midnet_bench.detectors.detector_node
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_node_fed_with_poses_and_scans_detects_what_the_trial_s_own_does() -> None:
    parameters = DetectionParameters.of(robots=2, engine="fast")
    with DetectionTrial(parameters, 3) as trial:
        node = DetectorNode(parameters, trial.prior_map, 2)
        for guard in trial.guards:
            own = guard.observe

            def observe(ranges_m, lidar, time_s, guard=guard, own=own) -> None:
                own(ranges_m, lidar, time_s)
                node.observe(guard.index, guard.pose, ranges_m, lidar, time_s)

            guard.observe = observe
        for _ in range(10):
            frame = trial.next_frame()
            observations = node.observations([guard.pose for guard in trial.guards])
            again = node.detect(observations, trial.fleet.time_s)
            assert (again.detections, again.robots) == (frame.detections, frame.robots)
        assert frame.detections
        np.testing.assert_array_equal(node.prior.data, trial.prior.data)


GEOMETRY = LidarGeometry(4, 0.0, math.pi / 2, 0.1, 3.5, Pose2D(0.0, 0.0, 0.0))


def empty_room() -> OccupancyGrid:
    return OccupancyGrid(np.zeros((100, 100), np.int8), 0.05, (0.0, 0.0))


@pytest.mark.parametrize(
    ("robot", "pose", "ranges", "lidar", "time_s"),
    [
        (1, (2.0, 2.0, 0.0), 4, GEOMETRY, 0.0),
        (0, (2.0, 2.0, math.nan), 4, GEOMETRY, 0.0),
        (0, (math.inf, 2.0, 0.0), 4, GEOMETRY, 0.0),
        (0, (2.0, 2.0, 0.0), 5, GEOMETRY, 0.0),
        (0, (2.0, 2.0, 0.0), 0, GEOMETRY, 0.0),
        (0, (2.0, 2.0, 0.0), 4, replace(GEOMETRY, angle_increment_rad=math.nan), 0.0),
        (0, (2.0, 2.0, 0.0), 4, replace(GEOMETRY, mount=Pose2D(0.0, math.inf, 0.0)), 0.0),
        (0, (2.0, 2.0, 0.0), 4, replace(GEOMETRY, range_max_m=math.nan), 0.0),
        (0, (2.0, 2.0, 0.0), 4, GEOMETRY, math.inf),
    ],
)
def test_what_no_robot_can_say_is_refused_at_the_door(
    robot: int, pose: tuple[float, float, float], ranges: int, lidar: LidarGeometry, time_s: float
) -> None:
    node = DetectorNode(DetectionParameters.of(), empty_room(), 1)
    with pytest.raises(InputError, match="scan: "):
        node.observe(robot, Pose2D(*pose), np.ones(ranges), lidar, time_s)


def test_geometry_may_change_from_scan_to_scan() -> None:
    node = DetectorNode(DetectionParameters.of(), empty_room(), 1)
    for beams in (4, 360, 8):
        lidar = replace(GEOMETRY, beams=beams, angle_increment_rad=2.0 * math.pi / beams)
        pose = Pose2D(2.5, 2.5, 0.0)
        node.observe(0, pose, np.ones(beams), lidar, 0.0)
        (frame,) = [node.detect(node.observations([pose]), 0.0)]
        assert frame.detections


@pytest.mark.parametrize(("least", "boxes"), [(0, 2), (1, 2), (2, 1), (3, 0)])
def test_a_box_of_fewer_returns_is_dropped(least: int, boxes: int) -> None:
    """Two returns side by side, and one alone, in an empty room."""
    ranges = np.full(360, np.inf)
    ranges[[10, 11, 200]] = 1.0
    lidar = replace(GEOMETRY, beams=360, angle_increment_rad=math.tau / 360)
    node = DetectorNode(DetectionParameters.of(min_returns=least), empty_room(), 1)
    pose = Pose2D(2.5, 2.5, 0.3)
    node.observe(0, pose, ranges, lidar, 0.0)
    for explain in (False, True):
        assert len(node.detect(node.observations([pose]), 0.0, explain).detections) == boxes
