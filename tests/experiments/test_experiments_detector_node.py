"""From a map, poses and scans to boxes, where neither simulator nor arena nor agents can be imported."""

import subprocess
import sys

import numpy as np

from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial
from midnet_bench.experiments.guarded.detector_node import DetectorNode


def test_the_node_needs_no_simulator_no_arena_and_no_agents() -> None:
    program = """
import sys
for room in ("simulation", "arena", "agents", "campaign"):
    sys.modules[f"midnet_bench.{room}"] = None
sys.modules["pybullet"] = None
import midnet_bench.experiments.guarded.detector_node
"""
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_node_fed_with_poses_and_scans_detects_what_the_trial_s_own_does() -> None:
    parameters = DetectionParameters.of(robots=2)
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
            assert again == frame
        assert frame.detections
        np.testing.assert_array_equal(node.prior.data, trial.prior.data)
