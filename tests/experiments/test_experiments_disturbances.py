"""Each disturbance of a guarded trial changes what it should, and nothing else."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from unittest import mock

import numpy as np
import pytest

from midnet_bench.agents.mobile_robot import Guard, MobileRobot
from midnet_bench.errors import InputError
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import DetectionTrial, run_detection
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.labyrinth.trial import LabyrinthTrial, run_labyrinth
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.experiments.mapping.trial import ExplorationTrial
from midnet_bench.geometry import Pose2D, wrap_angle
from tests.experiments.corridor import SOON

SEED = 2001


def of(**values: Any) -> DetectionParameters:
    return DetectionParameters.of(
        **{"engine": "fast", "prior_map": "exact", "robots": 2, "frames": 6, **values}
    )


@contextmanager
def trial(**values: Any) -> Iterator[DetectionTrial]:
    with DetectionTrial(of(**values), SEED) as made:
        yield made


def scan_now(made: DetectionTrial) -> tuple[np.ndarray, np.ndarray]:
    """Of every robot, with the same noise each time, and which bodies the beams meet."""
    robots = np.arange(len(made.fleet.robots))
    true = made.lidars.true_scan(robots)
    noise = made.lidars.noise([*map(np.random.default_rng, robots)])
    return made.lidars.measured(true.ranges_m, robots, noise), true.bodies


def test_dropout_takes_a_share_of_the_beams_and_leaves_the_others() -> None:
    with trial() as whole, trial(lidar_dropout=0.3) as holey:
        robots = range(len(whole.fleet.robots))
        before, lost = scan_now(whole)[0], []
        for _ in range(20):
            after = holey.lidars.scan(robots, holey.lidars.noise([np.random.default_rng(i) for i in robots]))
            gone = np.isinf(after) & np.isfinite(before)
            np.testing.assert_array_equal(after[~gone], before[~gone])
            lost.append(gone)
        assert np.mean(np.array(lost)[:, np.isfinite(before)]) == pytest.approx(0.3, abs=0.01)
        assert not (lost[0] == lost[1]).all(), "drawn anew for each scan"
        np.testing.assert_array_equal(scan_now(holey)[0], before, "who is in sight is told without dropout")


@pytest.mark.slow
@pytest.mark.parametrize("hz", [1, 10])
def test_lidars_scan_as_often_as_set_and_control_as_ever(hz: int) -> None:
    with trial(lidar_hz=hz) as made:
        scans, cycles = [], []
        for robot in made.fleet.robots:
            robot.observe = mock.Mock(wraps=robot.observe)  # type: ignore[method-assign]
            robot.control = mock.Mock(wraps=robot.control)  # type: ignore[method-assign]
            scans.append(robot.observe)
            cycles.append(robot.control)
        for _ in range(10):
            made.next_frame()
    assert {calls.call_count for calls in scans} == {2 * hz}
    assert {calls.call_count for calls in cycles} == {20}


@pytest.mark.parametrize(("hz", "driven_by"), [(5, 2), (5.5, 2), (15, 4), (30, 4)])
def test_sensors_are_read_of_the_time_since_they_were_last(hz: float, driven_by: int) -> None:
    """Each robot's intervals add up to the time, and its costmaps take a scan of a control cycle at most."""
    with trial(lidar_hz=hz) as made:
        fleet = made.fleet
        read = fleet._imus.read = mock.Mock(wraps=fleet._imus.read)  # type: ignore[method-assign]
        for robot in fleet.robots:
            robot.navigator.observe = mock.Mock(wraps=robot.navigator.observe)  # type: ignore[method-assign]
        times_s: dict[int, list[float]] = {robot.index: [] for robot in fleet.robots}
        intervals_s: dict[int, list[float]] = {robot.index: [] for robot in fleet.robots}
        for _ in range(12):  # 0.4 s
            before = read.call_count
            fleet.step()
            for rows, _, _, elapsed_s in (call.args for call in read.call_args_list[before:]):
                for row in rows.tolist():
                    times_s[row].append(fleet.time_s)
                    intervals_s[row].append(elapsed_s)
        for row, times in times_s.items():
            np.testing.assert_allclose(np.diff(times), intervals_s[row][1:], atol=1e-12)
            assert 4 <= len(times) <= 12
        scans = {robot.navigator.observe.call_count for robot in fleet.robots}  # type: ignore[attr-defined]
        assert scans <= {driven_by - 1, driven_by, driven_by + 1}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hz", "scans", "driven_by"), [(5.5, 22, 22), (15, 60, 40), (30, 120, 40), (40, 120, 40)]
)
def test_scans_between_control_cycles_are_of_where_the_robot_is_then(
    hz: float, scans: int, driven_by: int
) -> None:
    """In 4 s; of several scans in one cycle a robot drives by the newest, as in costmap_2d."""
    with trial(lidar_hz=hz, localization="truth", odometry="world") as made:
        taken, kept = [], []
        for robot in made.fleet.robots:
            robot.sense = mock.Mock(wraps=robot.sense)  # type: ignore[method-assign]
            robot.observe = mock.Mock(wraps=robot.observe)  # type: ignore[method-assign]
            taken.append(robot.sense)
            kept.append(robot.observe)
        off_m: list[float] = []
        stamps: list[float] = []

        def scanned(robots: Sequence[MobileRobot], ranges_m: np.ndarray) -> None:
            assert len(made.lidars.newest.ranges_m) == len(robots) == len(ranges_m)  # type: ignore[union-attr]
            off_m.extend(robot.pose.distance_to(made.world.pose(robot.index)) for robot in robots)
            scans_of = [robot.scan for robot in robots if isinstance(robot, Guard)]
            stamps.extend(scan.stamp_s - made.fleet.time_s for scan in scans_of if scan is not None)

        made.fleet.scan_callbacks.append(scanned)
        for _ in range(20):
            made.next_frame()
    assert {calls.call_count for calls in taken} <= {scans - 1, scans, scans + 1}
    assert {calls.call_count for calls in kept} <= {driven_by - 1, driven_by, driven_by + 1}
    assert max(off_m) < 1e-12
    assert not any(stamps)


def test_explorers_wait_for_their_first_scan() -> None:
    parameters = MappingParameters.of(engine="fast", lidar_hz=1, time_limit_s=4.0)
    with ExplorationTrial(parameters, SEED) as made:
        for _ in made.snapshots():
            pass
        assert not made.result().finished
        assert made.explorers[0].goal is not None


def test_sizes_change_intruders_where_they_are() -> None:
    with trial() as usual, trial(mobile_scale=2.0) as other:
        np.testing.assert_array_equal(usual.world.poses(), other.world.poses())
        for guard in usual.guards:
            assert usual.lidars.outline(guard.index) == other.lidars.outline(guard.index)
        for robot in usual.intruders:
            small, large = usual.lidars.outline(robot.index), other.lidars.outline(robot.index)
            assert large.x_max - large.x_min == pytest.approx(2.0 * (small.x_max - small.x_min))
            assert large.center == pytest.approx(small.center)
        assert usual.layout.stationary == other.layout.stationary
        seen = [scan_now(made)[1] for made in (usual, other)]
        guards, mobile = (
            [np.isin(bodies, [robot.index for robot in team]).sum() for bodies in seen]
            for team in (usual.guards, usual.intruders)
        )
        assert mobile[1] > 1.5 * mobile[0]
        assert guards[0] >= guards[1] > 0


def test_a_guard_takes_itself_to_start_so_far_off_and_its_gyroscope_does_not_mend_that() -> None:
    with trial(start_error_m=0.1, start_error_deg=5.0, imu_noise="none") as made, trial() as usual:
        np.testing.assert_array_equal(made.world.poses(), usual.world.poses())
        for robot in made.intruders:
            assert robot.pose == usual.fleet.robots[robot.index].pose
        offsets = []
        for guard in made.guards:
            true = Pose2D(*made.world.poses()[guard.index].tolist())
            assert math.dist(guard.pose[:2], true[:2]) == pytest.approx(0.1)
            offsets.append(wrap_angle(guard.pose.yaw - true.yaw))
        assert np.abs(offsets) == pytest.approx(math.radians(5.0))
        assert made.guards[0].pose != made.guards[1].pose
        for _ in range(15):
            made.next_frame()
        for guard, offset in zip(made.guards, offsets, strict=True):
            now = wrap_angle(guard.pose.yaw - float(made.world.poses()[guard.index, 2]))
            assert now == pytest.approx(offset, abs=0.05), "at most half a control cycle at 2.8 rad/s"


def test_a_dead_guard_stands_and_sees_no_more_and_the_others_go_on() -> None:
    with trial(dying_guards=1, dying_after_s=2.0) as made, trial() as usual:
        dead, alive = made.guards
        for _ in range(10):
            made.next_frame()
            usual.next_frame()
        np.testing.assert_array_equal(made.world.poses(), usual.world.poses(), "until then nothing differs")
        assert made.guards_alive == [alive]
        at, believed = made.world.pose(dead.index), dead.pose
        seen = dead.detection_costmaps[0].costs.copy()
        for _ in range(15):
            made.next_frame()
        assert math.dist(made.world.pose(dead.index)[:2], at[:2]) < 0.08, "it rolls to a stop"
        assert dead.pose == believed
        np.testing.assert_array_equal(dead.detection_costmaps[0].costs, seen)
        assert made.world.active[dead.index]
        assert made.fleet.health.distances_m[alive.index] > usual.fleet.health.distances_m[alive.index] + 0.1


def test_a_dead_guard_catches_nobody() -> None:
    parameters = LabyrinthParameters.of(
        engine="fast", prior_map="exact", robots=1, dying_guards=1, dying_after_s=0.0, capture_distance_m=5.0
    )
    with LabyrinthTrial(parameters, SEED) as made:
        made.next_frame()
        assert made.guards_alive == []
        intruder = made.intruders[0]
        box = made.lidars.outline(intruder.index)
        assert made._catchers(intruder, [(box, made.guards[0])]) == []


@pytest.mark.slow
def test_guards_of_the_labyrinth_chase_nobody_of_whom_midnet_never_hears() -> None:
    seen = {}
    for loss in (0.0, 1.0):
        parameters = LabyrinthParameters.of(**{**SOON, "capture": "within"}, message_loss=loss)
        (row,) = run_labyrinth(parameters, 6).tables["trial"]
        seen[loss] = (row["detected"], row["targets"])
    assert seen == {0.0: (1, 1), 1.0: (0, 0)}


def test_the_network_changes_what_is_detected_and_no_robot() -> None:
    usual = run_detection(of(), SEED)
    assert run_detection(of(message_timeout_s=3600.0), SEED) == usual, "a network without delay and loss"
    for change in ({"message_delay_s": 0.5}, {"message_loss": 0.3}, {"message_jitter_s": 0.3}):
        other, again = (run_detection(of(**change), SEED).tables for _ in range(2))
        assert other["robots"] == usual.tables["robots"]
        assert other["frames"] != usual.tables["frames"]
        assert again == other


def test_a_guards_messages_do_not_depend_on_the_team() -> None:
    """Who gets through when: the first guard's stamps in a team of one are those in a team of three."""
    heard = []
    for robots in (1, 3):
        with trial(robots=robots, message_loss=0.5, message_jitter_s=0.2) as made:
            stamps = []
            for _ in range(10):
                made.next_frame()
                message = made._network._network.latest(0, made.fleet.time_s)
                stamps.append(message.stamp_s if message else None)
            heard.append(stamps)
    assert heard[0] == heard[1]


def test_midnet_goes_by_poses_of_a_second_ago_and_every_detector_does() -> None:
    parameters = of(message_delay_s=1.0)
    with DetectionTrial(parameters, SEED, variants=[of(thresh_local=60)]) as made:
        starts, believed = made.guard_poses(), []
        for number in range(12):
            made.next_frame()
            believed.append(made.guard_poses())
            nodes = (made.detector, *made.variant_detectors)
            told = [made._network.received(node, made.fleet.time_s) for node in nodes]
            for observations in told:
                expected = believed[number - 5] if number >= 5 else starts
                assert [one.pose for one in observations] == expected
            own, other = (np.array([one.costmap.data for one in observations]) for observations in told)
            np.testing.assert_array_equal(own, other, "one threshold on the same costmaps")
            assert own.any() == (number >= 5), "nothing is seen before the first message"
        found = [node.midnet.update(made.observations(node)).detections for node in nodes]
        assert found[0] != found[1]


def test_who_is_never_heard_of_detects_nothing() -> None:
    (scores,) = run_detection(of(message_loss=1.0), SEED).tables["scores"]
    assert (scores["tp"], scores["fp"]) == (0, 0)
    assert int(str(scores["fn"])) > 0


def test_what_a_dead_guard_saw_last_is_left_out_after_the_time_out() -> None:
    seen_by_the_dead = {}
    for timeout_s in (None, 1.0):
        with trial(dying_guards=1, dying_after_s=1.0, message_timeout_s=timeout_s) as made:
            frames = [made.next_frame() for _ in range(15)]
            seen_by_the_dead[timeout_s] = [0 in frame.robots for frame in frames]
    assert all(seen_by_the_dead[None][5:])
    assert seen_by_the_dead[1.0][:9] == seen_by_the_dead[None][:9]
    assert not any(seen_by_the_dead[1.0][10:])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"dying_guards": 3}, "dying_guards: 3 of 2 guards"),
        ({"start_error_m": 0.1, "localization": "truth"}, "start_error_m"),
        ({"lidar_hz": 0.1}, "lidar_hz"),
        ({"message_timeout_s": 0}, "message_timeout_s"),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        of(**values)
