"""Odometry placed on a map: where the robot began, as given or found.

Poses by odometry begin wherever the robot was switched on. One fixed transform before them puts them onto the
map. A start that was typed is refined by the walls about it; without one the whole map is searched.
"""

import math
from collections.abc import Callable, Sequence

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.files.survey import Survey
from midnet_bench.recording.fitting.fit import Walls, samples_of
from midnet_bench.recording.fitting.setup_check import FULL_BEAMS, GOOD, POOR, WORTH
from midnet_bench.recording.fitting.setup_search import MAP, Candidate, Returns, Search
from midnet_bench.recording.plan import AT_ORIGIN, RobotPlan
from midnet_bench.recording.setup import EVERY, FOUND, RecordingSetup

APART_M, APART_RAD = 1.0, math.radians(20.0)
"""Two places that differ by less are one."""


def placed(
    robot: RobotPlan,
    surveys: Sequence[Survey],
    setup: RecordingSetup,
    offsets_ns: Sequence[int],
    prior_map: OccupancyGrid,
    note: Callable[[str], None],
) -> Pose2D:
    """What takes a robot's poses into the map's frame, as key ``start`` says; without one they are there.

    Raises:
        InputError: no scan has a pose, or no place of the map brings the returns onto walls.
    """
    start = setup.start.get(robot.carrier, setup.start.get(EVERY))
    if start is None:
        return AT_ORIGIN
    samples = samples_of(surveys, robot, setup.clock, setup.max_pose_age_s, offsets_ns)
    if not samples:
        raise InputError(f"start: {robot.name}: no scan of it has a pose; see 'midnet-bench replay FILE'")
    walls, first, moved = Walls(prior_map), samples[0].pose, AT_ORIGIN
    if not isinstance(start, str):
        x, y, yaw_deg = start
        moved = Pose2D(x, y, math.radians(yaw_deg)).compose(first.inverse())
        samples = samples_of(surveys, robot.moved(moved), setup.clock, setup.max_pose_age_s, offsets_ns)
    search = Search(Returns(samples, FULL_BEAMS), walls, robot.mount)
    found, others = _anywhere(search) if start == FOUND else (_refined(search), [])
    better = search.returns.setup(found.values, False).map_moved
    x, y, yaw = better.compose(moved).compose(first)
    said = f"[{x:z.2f}, {y:z.2f}, {math.degrees(wrap_angle(yaw)):z.1f}]"
    if start == FOUND and found.share < POOR:
        raise InputError(
            f"start: {robot.name}: no place of the map brings more than {found.share:.2f} of the returns "
            "onto walls; is it the map of this place (--map), and the mount right (--mount)? Else give "
            "--start X,Y,YAW_DEG"
        )
    note(f"{robot.name}: began at start: {said} on the map; {found.share:.2f} of the returns lie on walls")
    for other in others:
        x, y, yaw = search.returns.setup(other.values, False).map_moved.compose(first)
        note(
            f"{robot.name}: {other.share:.2f} do from [{x:z.2f}, {y:z.2f}, {math.degrees(yaw):z.1f}], too: "
            "the recording does not tell the two apart; --start says which"
        )
    if found.share < GOOD:
        note(f"{robot.name}: few returns for the right place; --check looks for the mount as well")
    return better.compose(moved)


def _refined(search: Search) -> Candidate:
    """The place near where the poses are now by which more returns lie on walls; it itself if none is."""
    here = search.as_it_is()
    better = search.refined(here, MAP)
    return better if better.share >= here.share and better.score > here.score else here


def _anywhere(search: Search) -> tuple[Candidate, list[Candidate]]:
    """The best place of all, and another one that is as good within noise, if there is one."""
    every = sorted(search.places(), key=lambda each: -each.score)
    best = search.refined(every[0], MAP, wide_m=0.15)
    least = best.score - max(WORTH, search.noise)

    def is_apart(other: Candidate) -> bool:
        x, y, turn = (other.values - best.values)[list(MAP)].tolist()
        return math.hypot(x, y) > APART_M or abs(wrap_angle(turn)) > APART_RAD

    return best, [each for each in every[1:] if each.score >= least and is_apart(each)][:1]
