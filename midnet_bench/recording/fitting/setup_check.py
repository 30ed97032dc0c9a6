"""Whether scans, poses and map fit, which key corrects what is wrong, and where odometry began."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.errors import InputError
from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.files.survey import spread
from midnet_bench.recording.fitting.fit import Fit, Sample, Walls, fit_of, samples_of
from midnet_bench.recording.fitting.setup_search import (
    DELAY,
    FACTOR,
    MAP,
    MOUNT,
    SEEN,
    SLOWEST_MPS,
    Candidate,
    Returns,
    Search,
)
from midnet_bench.recording.plan import AT_ORIGIN, Recorded, RobotPlan
from midnet_bench.recording.setup import EVERY, FOUND, RecordingSetup

QUICK_SAMPLES, QUICK_BEAMS = 40, 40
FULL_SAMPLES, FULL_BEAMS = 120, 90
WORTH = 0.03  # Another setup is proposed only if it brings at least so much more of the returns onto walls.
ALARM = 0.06  # A replay warns only of one that raises that share, or the mean closeness to walls, by so much.
GOOD, POOR = 0.6, 0.4
"""A better setup that brings fewer returns than the one onto walls may be so by chance. If there is no better
one, and as it is fewer than the other lie on walls, the map is taken for one of another place."""
PLACED = "Odometry takes --place found"
FEW_RETURNS = 100
LONGEST_LINE = 300
AGAIN_M = 0.15  # A refinement of what was refined on fewer returns begins so narrow.
ALIKE = 0.02
"""Of two changes that differ in no more of what they do to the returns, neither can be preferred."""
LARGEST_INTERVAL = {**dict.fromkeys((0, 1, 4, 5), 1.0), **dict.fromkeys((2, 6), 0.5), 3: 0.5}
"""how far the interval of a parameter is followed: metres, radians, seconds"""
NAMES = ("mount x", "mount y", "mount yaw", "scan delay", "map x", "map y", "map yaw", "range factor")
APART_M, APART_RAD = 1.0, math.radians(20.0)  # Two places that differ by less are one.


class Range(NamedTuple):
    """How far one parameter can be changed, the others held, within sampling noise of the share."""

    below: float  # the found value; metres, radians or seconds
    above: float
    is_open: bool
    """whether the search for its ends was given up: the recording says nothing of this parameter"""


class Proposal(NamedTuple):
    """The setup that a search found, and how sure it is."""

    kinds: tuple[str, ...]
    """what differs from what was set, of "mount", "turn", "mirror", "delay", "map"; empty: nothing"""
    mount: Pose2D  # the sensor in the robot's frame
    turned_rad: float  # by how much it is turned against the one that was set, within [-pi, pi)
    is_mirrored: bool  # whether the beams go round the other way than the samples' geometry says
    delay_s: float  # by how much a scan's time is later than the instant at which it was measured
    map_moved: Pose2D  # where the frame of the poses lies in that of the map; all zero where the two are one
    share_before: float
    share_after: float
    start: Pose2D  # where the robot was at the first scan, in the frame of a map that is moved so
    ranges: dict[str, Range] = {}  # noqa: RUF012
    """of the parameters by ``NAMES``; metres, radians, seconds; empty where none is needed"""
    alike: tuple["Proposal", ...] = ()
    """other changes that would correct as much: the recording does not decide"""
    cannot_tell: tuple[str, ...] = ()  # sentences: along which directions the recording says nothing

    @property
    def is_good(self) -> bool:
        """Whether the returns lie on the walls by it as they do in the place that a map is of."""
        return self.share_after >= GOOD


class Verdict(NamedTuple):
    """Whether scans, poses and map fit, for a line before any score."""

    kinds: tuple[str, ...]
    """what is wrong: those of ``Proposal.kinds``, or "off the map", "other place", "few returns"
    (empty: nothing)"""
    lines: tuple[str, ...]
    """one for each finding, with its figures and what corrects it; one that says that it fits"""
    share: float  # of the returns that lie on mapped walls; NaN without one

    @property
    def fits(self) -> bool:
        """Whether nothing is wrong."""
        return not self.kinds


def verdict(
    samples: Sequence[Sample], grid: OccupancyGrid, mirrored: bool = False, delay_s: float = 0.0
) -> Verdict:
    """The findings before a replay, in about a quarter of a second of CPU time.

    Args:
        samples: of the whole recording; no more than ``QUICK_SAMPLES`` of them, spread evenly, are used.
        grid: the map, int8, map frame.
        mirrored: whether the samples' geometry is mirrored already.
        delay_s: what the samples' times are earlier by than the stamps already.

    Raises:
        InputError: the map has no wall.
    """
    walls, chosen = Walls(grid), spread(samples, QUICK_SAMPLES)
    fit = fit_of(chosen, walls)
    share = fit.on_walls
    if fit.returns < FEW_RETURNS:
        line = (
            f"only {fit.returns} returns in {len(chosen)} of the scans: too few to say whether scans "
            "and map fit; are ranges, limits and the topic right?"
        )
        return Verdict(("few returns",), (line,), share)
    faults: dict[str, str] = {}
    if fit.robot_off_map > 0.5:
        x, y = np.median([sample.pose[:2] for sample in chosen], axis=0).tolist()
        x_min, y_min, x_max, y_max = grid.extent
        faults["off the map"] = (
            f"the robot is off the map or in its unknown cells in {fit.robot_off_map:.0%} of the scans, "
            f"about ({x:.1f}, {y:.1f}) m; the map spans x {x_min:.1f} to {x_max:.1f}, y {y_min:.1f} to "
            f"{y_max:.1f} m: are map (--map) and poses of one place and one frame?"
        )
    search, plain, best, others = _quick_search(chosen, walls)
    gain = max(best.share - plain.share, best.score - plain.score)
    if best.share >= plain.share + WORTH and gain >= ALARM and best.share >= GOOD:
        proposal = _proposal(search, plain, best, others)
        lines = (*faults.values(), line_of(proposal, mirrored, delay_s))
        return Verdict((*faults, *proposal.kinds), lines, share)
    if share < POOR:
        most = max(best.share, share)
        faults["other place"] = (
            f"{share:.2f} of the returns lie on mapped walls, and no mount, turn, mirroring, delay or shift "
            f"of the map that was tried brings more than {most:.2f}: is it the map of this place and of the "
            f"poses' frame (--map)? {PLACED}; --check searches further"
        )
    return Verdict(tuple(faults), tuple(faults.values()) or (_fits(fit, walls),), share)


def _fits(fit: Fit, walls: Walls) -> str:
    line = f"{fit.on_walls:.2f} of the returns lie on mapped walls (within {walls.near_m:.2f} m)"
    if fit.on_walls >= GOOD:
        return line + ": scans, poses and map fit"
    where = "in unknown cells or off the map" if fit.unmapped > fit.in_the_free else "in the free"
    rest = max(fit.unmapped, fit.in_the_free)
    return line + f"; {rest:.2f} lie {where}, and no other setup does clearly better"


def find_setup(samples: Sequence[Sample], grid: OccupancyGrid) -> Proposal:
    """The setup by which most returns lie on walls, in about a second of CPU time.

    First one thing is changed at a time: the mount (with any turn), the same with the beams mirrored, the
    delay, the map's place; all the plane is searched for the map where none of them brings half of the
    returns onto walls. Then whatever else brings ``WORTH`` more is added. Of changes that do as much, the
    most usual one is taken and the others are in ``alike``.

    Args:
        samples: of the whole recording; at most ``FULL_SAMPLES`` are used, spread evenly.
        grid: the map, int8, map frame.

    Raises:
        InputError: the map has no wall, or the samples have hardly a return.
    """
    walls = Walls(grid)
    _, _, best, others = _quick_search(spread(samples, QUICK_SAMPLES), walls)
    many = spread(samples, FULL_SAMPLES)
    fine = Search(Returns(many, FULL_BEAMS), walls, many[0].lidar.mount)
    plain = fine.as_it_is()
    best, *others = (fine.refined(each, each.changed, AGAIN_M) for each in (best, *others))
    if best.share < plain.share + WORTH:
        best, others = plain, []
    best = _more(fine, best)
    others = [each for each in others if not set(each.changed) <= set(best.changed)]
    proposal = _proposal(fine, plain, best, others)
    return proposal._replace(ranges={NAMES[k]: _range(fine, best, k) for k in LARGEST_INTERVAL})


def _quick_search(
    samples: Sequence[Sample], walls: Walls
) -> tuple[Search, Candidate, Candidate, list[Candidate]]:
    """A search of few returns: itself, no change, the most usual of the best changes, the others as good."""
    search = Search(Returns(samples, QUICK_BEAMS), walls, samples[0].lidar.mount)
    plain = search.as_it_is()
    tried = [search.turned(False), search.turned(True), search.moved()]
    if search.returns.speed_mps >= SLOWEST_MPS:
        tried.append(search.late())
    better = [each for each in tried if each.share >= plain.share + WORTH]
    best, others = plain, list[Candidate]()
    if better:
        least = max(each.score for each in better) - max(WORTH, search.noise)
        alike = [each for each in better if each.score >= least]
        best, *others = sorted(alike, key=lambda each: _oddity(each, plain))
    if best.share < GOOD:  # a place of the map anywhere in the plane, if that is clearly better
        anywhere = max((*search.places(False), *search.places(True)), key=lambda each: each.score)
        if anywhere.score >= best.score + WORTH:
            best, others = anywhere, []
    return search, plain, best, others


def _oddity(candidate: Candidate, plain: Candidate) -> float:
    """How unusual such a mistake is, where the returns do not decide.

    A mount that is not given is most often the one that is missing, and lies within a few decimetres of what
    the poses are of; one that was given is seldom far off.
    """
    off = candidate.values - plain.values
    if candidate.changed == DELAY:
        return 1.0 + abs(float(off[3])) / 0.1
    if candidate.changed == MAP:
        return 1.0 + math.hypot(off[4], off[5]) / 0.5
    usual_m = 0.05 if plain.values[:3].any() else 0.2
    odd = math.hypot(off[0], off[1]) / usual_m + abs(wrap_angle(4.0 * float(off[2])) / 4.0) / 0.2
    return odd + (_quarter_turns(float(off[2])) != 0) + 2.0 * candidate.mirrored


def _quarter_turns(angle_rad: float) -> int:
    """-1, 0, 1 or 2 quarter turns, whichever is nearest."""
    return (round(angle_rad / (math.pi / 2.0)) + 1) % 4 - 1


def _more(search: Search, best: Candidate) -> Candidate:
    """``best`` with whatever else brings ``WORTH`` more, one thing after the other.

    A delay is judged with the ranges' factor free on both sides: ranges that are some percent short look like
    a delay in a drive towards a wall.
    """
    if 3 not in best.changed and search.returns.speed_mps >= SLOWEST_MPS:
        changed = (*best.changed, *FACTOR)
        without, late = search.refined(best, changed), search.refined(best, (*changed, *DELAY))
        alone = search.refined(best, (*best.changed, *DELAY))
        if _is_worth(without, late) and _is_worth(best, alone):
            best = alone
    if 3 in best.changed:
        # a map that lies off by half a cell would move the delay by a fifth
        values = best.values.copy()
        values[3] = search.refined(best, tuple(sorted({*best.changed, *MAP}))).values[3]
        timed = search.candidate(best.changed, values, best.mirrored)
        best = search.refined(timed, tuple(k for k in best.changed if k != 3), AGAIN_M)
    for changed in (MOUNT, MAP):
        wider = search.refined(best, tuple(sorted({*best.changed, *changed})))
        if not set(changed) <= set(best.changed) and _is_worth(best, wider):
            best = wider
    return best


def _is_worth(before: Candidate, after: Candidate) -> bool:
    """Whether a change brings more onto walls than one that moves all by a part of a cell can."""
    return after.share >= before.share + WORTH and after.score >= before.score + WORTH


def _proposal(search: Search, plain: Candidate, best: Candidate, others: Sequence[Candidate]) -> Proposal:
    found, *alike = (
        _bare(search.returns, plain, each)
        for each in (best, *(other for other in others if other.changed or other.mirrored))
    )
    return found._replace(alike=tuple(alike), cannot_tell=_cannot_tell(search, best))


def _bare(returns: Returns, plain: Candidate, candidate: Candidate) -> Proposal:
    changed, turned_rad = set(candidate.changed), wrap_angle(float(candidate.values[2] - plain.values[2]))
    mount = "turn" if _quarter_turns(turned_rad) and not candidate.mirrored else "mount"
    kinds = ("mirror",) * candidate.mirrored + tuple(
        kind for kind, own in ((mount, MOUNT), ("delay", DELAY), ("map", MAP)) if set(own) <= changed
    )
    x, y, yaw, delay_s = candidate.values[:4].tolist()
    moved = returns.map_moved(candidate.values)
    return Proposal(
        kinds,
        Pose2D(x, y, wrap_angle(yaw)),
        turned_rad,
        candidate.mirrored,
        delay_s,
        moved,
        plain.share,
        candidate.share,
        moved.compose(returns.first),
    )


def _range(search: Search, best: Candidate, number: int) -> Range:
    """Where the share falls below the best by more than noise, on both sides of the best value."""
    least, farthest = best.share - search.noise, LARGEST_INTERVAL[number]

    def stays(off: float) -> bool:
        values = best.values.copy()
        values[number] += off
        return search.candidate(best.changed, values, best.mirrored).share >= least

    low, low_open = _end(lambda off: stays(-off), farthest)
    high, high_open = _end(stays, farthest)
    return Range(low, high, low_open or high_open)


def _end(stays: Callable[[float], bool], farthest: float) -> tuple[float, bool]:
    """How far out ``stays`` holds, to a tenth, and whether it holds as far as ``farthest``."""
    inner, outer = 0.0, farthest / 128.0
    while stays(outer):
        if outer >= farthest:
            return farthest, True
        inner, outer = outer, 2.0 * outer
    for _ in range(4):
        middle = (inner + outer) / 2.0
        inner, outer = (middle, outer) if stays(middle) else (inner, middle)
    return inner, False


def _cannot_tell(search: Search, best: Candidate) -> tuple[str, ...]:
    """Along which directions the returns say nothing."""
    information, units, sentences = search.information(best), search.returns.units, []
    strengths, ways = np.linalg.eigh(information[4:6, 4:6])
    if strengths[0] < SEEN:
        angle = math.degrees(math.atan2(ways[1, 0], ways[0, 0])) % 180.0
        sentences.append(
            f"the walls that were seen say nothing of places along {angle:.0f} degrees of the map"
        )
    if search.returns.speed_mps < SLOWEST_MPS:
        sentences.append(
            "the robot hardly moves: nothing can be said of a scan delay, nor of mount against map"
        )
        return tuple(sentences)
    left, by_mount = _left_over(information, DELAY, MOUNT)
    if left < ALIKE:
        x, y, yaw = (-0.1 * units[3] / units[:3] * by_mount[:, 0]).tolist()
        sentences.append(
            "without turns or changes of speed a scan delay of 0.1 s outputs as a mount that is off by "
            f"x {x:z.2f}, y {y:z.2f} m and {math.degrees(yaw):z.1f} degrees"
        )
    if all(_left_over(information, (axis,), MAP)[0] < ALIKE for axis in (0, 1)):
        sentences.append("the heading hardly changes: a mount that is off outputs as a map that is moved")
    return tuple(sentences)


def _left_over(
    information: npt.NDArray[np.float64], what: tuple[int, ...], given: tuple[int, ...]
) -> tuple[float, npt.NDArray[np.float64]]:
    """The share of what parameters do to the returns that others cannot do as well, and how these would."""
    own, cross = information[np.ix_(what, what)], information[np.ix_(given, what)]
    by_others = np.linalg.pinv(information[np.ix_(given, given)], rcond=SEEN) @ cross
    rest = own - cross.T @ by_others
    return float(np.trace(rest) / max(np.trace(own), 1e-12)), by_others


def line_of(proposal: Proposal, mirrored: bool = False, delay_s: float = 0.0) -> str:
    """What is wrong, the shares before and after, and what corrects it; see :func:`verdict`."""
    after = f"{proposal.share_after:.2f}"
    line = f"{proposal.share_before:.2f} of the returns lie on mapped walls, "
    if not proposal.kinds:
        return line + "and no other setup does better"
    if not proposal.is_good:
        return f"{line}and no setup brings more than {after}: is it the map of this place (--map)? {PLACED}"
    what, keys = _in_words(proposal, mirrored, delay_s)
    line += f"{after} if {what}: {keys}"
    if proposal.alike:
        what, keys = _in_words(proposal.alike[0], mirrored, delay_s)
        line += f"; or, which this recording cannot tell, if {what}"
        line += f": {keys}" if len(line) + len(keys) + 2 < LONGEST_LINE else ""
    return line


def _in_words(proposal: Proposal, mirrored: bool, delay_s: float) -> tuple[str, str]:
    """What is wrong, and the keys of ``setup.yaml`` that make a proposal's setup."""
    kinds, parts, keys = proposal.kinds, [], []
    x, y, yaw = proposal.mount
    if proposal.is_mirrored:
        parts.append("the scans are mirrored")
        keys.append(f"mirrored: {'false' if mirrored else 'true'}")
    elif "turn" in kinds:
        parts.append(f"the scans are turned by {90 * _quarter_turns(proposal.turned_rad)} degrees")
    elif "mount" in kinds:
        degrees = math.degrees(yaw)
        parts.append(f"the laser sits at x {x:z.2f}, y {y:z.2f} m, {degrees:z.1f} degrees on the robot")
    if {"mount", "turn"} & {*kinds}:
        keys.append(f"mount: [{x:z.3f}, {y:z.3f}, {math.degrees(yaw):z.1f}]")
    if "delay" in kinds:
        late = "late" if proposal.delay_s > 0.0 else "early"
        parts.append(f"the scans come {abs(proposal.delay_s):.2f} s {late}")
        keys.append(f"delay_s: {delay_s + proposal.delay_s:z.3f}")
    if "map" in kinds:
        x, y, yaw = proposal.map_moved
        turned = f" and turned by {math.degrees(yaw):.0f} degrees" if abs(yaw) >= math.radians(2.0) else ""
        parts.append(f"the map is moved by x {x:z.2f}, y {y:z.2f} m{turned} against the poses")
        keys.append(f"start: {start_of(proposal)}")
    return " and ".join(parts), "; ".join(keys)


def start_of(proposal: Proposal) -> list[float]:
    """[x, y, yaw_deg] of key ``start``, exact enough for a map of 100 m."""
    x, y, yaw = proposal.start
    return [round(x, 3), round(y, 3), round(math.degrees(wrap_angle(yaw)), 2)]


def placed(
    robot: RobotPlan,
    recorded: Recorded,
    setup: RecordingSetup,
    prior_map: OccupancyGrid,
    note: Callable[[str], None],
) -> Pose2D:
    """What takes a robot's odometry into the map's frame, as key ``start`` says; without one it is there.

    Odometry begins wherever the robot was switched on. A start that was typed is refined by the walls about
    it; without one the whole map is searched.

    Raises:
        InputError: no scan has a pose, or no place of the map brings the returns onto walls.
    """
    start = setup.start.get(robot.carrier, setup.start.get(EVERY))
    if start is None:
        return AT_ORIGIN
    samples = samples_of(recorded, robot, setup)
    if not samples:
        raise InputError(f"start: {robot.name}: no scan of it has a pose; see 'midnet-bench replay FILE'")
    walls, first, moved = Walls(prior_map), samples[0].pose, AT_ORIGIN
    if not isinstance(start, str):
        x, y, yaw_deg = start
        moved = Pose2D(x, y, math.radians(yaw_deg)).compose(first.inverse())
        samples = samples_of(recorded, robot.moved(moved), setup)
    search = Search(Returns(samples, FULL_BEAMS), walls, robot.mount)
    found, others = _anywhere(search) if start == FOUND else (_refined(search), [])
    if start == FOUND and found.share < POOR:
        raise InputError(
            f"start: {robot.name}: no place of the map brings more than {found.share:.2f} of the returns "
            "onto walls; is it the map of this place (--map), and the mount right (--mount)? Else give "
            "--start X,Y,YAW_DEG"
        )
    better = search.returns.map_moved(found.values)
    x, y, yaw = better.compose(moved).compose(first)
    said = f"[{x:z.2f}, {y:z.2f}, {math.degrees(wrap_angle(yaw)):z.1f}]"
    note(f"{robot.name}: began at start: {said} on the map; {found.share:.2f} of the returns lie on walls")
    for other in others:
        x, y, yaw = search.returns.map_moved(other.values).compose(first)
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
    best = search.refined(every[0], MAP, AGAIN_M)
    least = best.score - max(WORTH, search.noise)

    def is_apart(other: Candidate) -> bool:
        x, y, turn = (other.values - best.values)[list(MAP)].tolist()
        return math.hypot(x, y) > APART_M or abs(wrap_angle(turn)) > APART_RAD

    return best, [each for each in every[1:] if each.score >= least and is_apart(each)][:1]
