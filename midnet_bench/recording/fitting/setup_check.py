"""Whether scans, poses and map fit, which key corrects what is wrong, and where odometry began."""

import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from midnet_bench.errors import InputError
from midnet_bench.geometry import Floats, Pose2D, wrap_angle
from midnet_bench.grid import OccupancyGrid
from midnet_bench.recording.files.survey import spread
from midnet_bench.recording.fitting.fit import Fit, Sample, Walls, fit_of, samples_of
from midnet_bench.recording.fitting.setup_search import (
    DELAY,
    FACTOR,
    MAP,
    MOUNT,
    SCALES_M,
    SLOWEST_MPS,
    Candidate,
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
PLACED = "Odometry takes --start found"
FEW_RETURNS = 100
LONGEST_LINE = 300
UNSEEN = 0.01  # A direction that no larger share of the returns constrains: beside a wall, at rest.
ALIKE = 0.02
"""Of two changes that differ in no more of what they do to the returns, neither can be preferred."""
PARAMETERS = {
    "mount x": 1.0,
    "mount y": 1.0,
    "mount yaw": 0.5,
    "scan delay": 0.5,
    "map x": 1.0,
    "map y": 1.0,
    "map yaw": 0.5,
}
"""the first values of a setup, and how far the interval of each is followed: metres, radians, seconds"""
APART_M, APART_RAD = 1.0, math.radians(20.0)  # Two places that differ by less are one.


class Range(NamedTuple):
    """How far one value can be changed, the others held, within sampling noise of the share."""

    below: float  # the found value; metres, radians or seconds
    above: float
    is_open: bool
    """whether the search for its ends was given up: the recording says nothing of this value"""


class Proposal(NamedTuple):
    """The setup that a search found, and how sure it is."""

    found: Candidate
    share_before: float
    alike: tuple[Candidate, ...] = ()
    """other changes that would correct as much: the recording does not decide"""
    cannot_tell: tuple[str, ...] = ()  # sentences: along which directions the recording says nothing
    ranges: dict[str, Range] = {}  # noqa: RUF012
    """by ``PARAMETERS``; empty where none is needed"""

    @property
    def is_good(self) -> bool:
        """Whether the returns lie on the walls by it as they do in the place that a map is of."""
        return self.found.share >= GOOD


class Verdict(NamedTuple):
    """Whether scans, poses and map fit, for a line before any score."""

    kinds: tuple[str, ...]
    """what is wrong: those of ``Candidate.kinds``, or "off the map", "other place", "few returns"
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
    """The findings before a replay, in about half a second of CPU time.

    The samples are mirrored already, and earlier than their stamps by ``delay_s``. Raises InputError: the map
    has no wall.
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
    search = Search(chosen, QUICK_BEAMS, walls)
    plain, (best, *others) = search.as_set, _quick_search(search)
    gain = max(best.share - plain.share, best.score - plain.score)
    if best.share >= max(plain.share + WORTH, GOOD) and gain >= ALARM:
        line = line_of(Proposal(best, plain.share, tuple(others)), mirrored, delay_s)
        return Verdict((*faults, *best.kinds), (*faults.values(), line), share)
    if share < POOR:
        faults["other place"] = (
            f"{share:.2f} of the returns lie on mapped walls, and no mount, turn, mirroring, delay or shift "
            f"of the map that was tried brings more than {max(best.share, share):.2f}: is it the map of this "
            f"place and of the poses' frame (--map)? {PLACED}; --check searches further"
        )
    return Verdict(tuple(faults), tuple(faults.values()) or (_fits(fit, walls),), share)


def _fits(fit: Fit, walls: Walls) -> str:
    line = f"{fit.on_walls:.2f} of the returns lie on mapped walls (within {walls.near_m:.3g} m)"
    if fit.on_walls >= GOOD:
        return line + ": scans, poses and map fit"
    where = "in unknown cells or off the map" if fit.unmapped > fit.in_the_free else "in the free"
    rest = max(fit.unmapped, fit.in_the_free)
    return line + f"; {rest:.2f} lie {where}, and no other setup does clearly better"


def find_setup(samples: Sequence[Sample], grid: OccupancyGrid) -> Proposal:
    """The setup by which most returns lie on walls, in a few seconds of CPU time.

    First one thing is changed at a time: the mount (with any turn), the same with the beams mirrored, the
    delay, the map's place; all the plane is searched for the map where none of them brings enough returns
    onto walls. Then whatever else brings ``WORTH`` more is added. Of changes that do as much, the
    most usual one is taken and the others are in ``alike``. Raises InputError: the map has no wall.
    """
    walls = Walls(grid)
    quick = _quick_search(Search(spread(samples, QUICK_SAMPLES), QUICK_BEAMS, walls))
    search = Search(spread(samples, FULL_SAMPLES), FULL_BEAMS, walls)
    best, *others = (search.refined(each, each.changed, SCALES_M[1:]) for each in quick)
    if best.share < search.as_set.share + WORTH:
        best, others = search.as_set, []
    best = _more(search, best)
    alike = tuple(each for each in others if not set(each.changed) <= set(best.changed))
    ranges = {name: _range(search, best, number) for number, name in enumerate(PARAMETERS)}
    return Proposal(best, search.as_set.share, alike, _cannot_tell(search, best), ranges)


def _quick_search(search: Search) -> list[Candidate]:
    """The most usual of the best changes, or what is set; then the others that are as good."""
    tried = [search.turned(False), search.turned(True), search.moved()]
    if search.speed_mps >= SLOWEST_MPS:
        tried.append(search.late())
    better = [each for each in tried if each.share >= search.as_set.share + WORTH]
    least = max((each.score for each in better), default=0.0) - max(WORTH, search.noise)
    alike = [each for each in better if each.score >= least]
    found = sorted(alike, key=lambda each: _oddity(each, search.as_set)) or [search.as_set]
    if found[0].share < GOOD:  # a place of the map anywhere in the plane, if that is clearly better
        anywhere = max((*search.places(False), *search.places(True)), key=lambda each: each.score)
        if anywhere.score >= found[0].score + WORTH:
            return [anywhere]
    return found


def _oddity(candidate: Candidate, plain: Candidate) -> float:
    """How unusual such a mistake is, where the returns do not decide.

    A mount that is not given is most often the one that is missing, and lies within a few decimetres of what
    the poses are of; one that was given is seldom far off.
    """
    off = (candidate.values - plain.values).tolist()
    if candidate.changed == DELAY:
        return 1.0 + abs(off[3]) / 0.1
    if candidate.changed == MAP:
        return 1.0 + math.hypot(off[4], off[5]) / 0.5
    usual_m = 0.05 if plain.values[:3].any() else 0.2
    odd = math.hypot(off[0], off[1]) / usual_m + abs(wrap_angle(4.0 * off[2]) / 4.0) / 0.2
    return odd + (candidate.quarter_turns != 0) + 2.0 * candidate.is_mirrored


def _more(search: Search, best: Candidate) -> Candidate:
    """``best`` with whatever else brings ``WORTH`` more, one thing after the other.

    A delay is judged with the ranges' factor free on both sides: ranges that are some percent short look like
    a delay in a drive towards a wall.
    """
    if 3 not in best.changed and search.speed_mps >= SLOWEST_MPS:
        changed = (*best.changed, *FACTOR)
        without, late = search.refined(best, changed), search.refined(best, (*changed, *DELAY))
        alone = search.refined(best, (*best.changed, *DELAY))
        if _is_worth(without, late) and _is_worth(best, alone):
            best = alone
    if 3 in best.changed:
        # a map that lies off by half a cell would move the delay by a fifth
        values = best.values.copy()
        values[3] = search.refined(best, tuple(sorted({*best.changed, *MAP}))).values[3]
        timed = best._replace(values=values)
        best = search.refined(timed, tuple(k for k in best.changed if k != 3), SCALES_M[1:])
    for changed in (MOUNT, MAP):
        wider = search.refined(best, tuple(sorted({*best.changed, *changed})))
        if not set(changed) <= set(best.changed) and _is_worth(best, wider):
            best = wider
    return best


def _is_worth(before: Candidate, after: Candidate) -> bool:
    """Whether a change brings more onto walls than one that moves all by a part of a cell can."""
    return after.share >= before.share + WORTH and after.score >= before.score + WORTH


def _range(search: Search, best: Candidate, number: int) -> Range:
    """Where the share falls below the best by more than noise, on both sides of the best value."""
    least, farthest = best.share - search.noise, list(PARAMETERS.values())[number]
    offsets = [0.0, *(farthest * np.exp2(np.arange(-48, 1) / 6.0)).tolist()]

    def first_off(sign: float) -> int:
        def is_off(offset: float) -> bool:
            values = best.values.copy()
            values[number] += sign * offset
            return search.candidate(values, best.is_mirrored).share < least

        # by doubling: further out the share may rise again
        beyond = next((k for k in range(1, 50, 6) if is_off(offsets[k])), len(offsets))
        return bisect_left(offsets, True, max(beyond - 6, 0), beyond, key=is_off)

    below, above = first_off(-1.0), first_off(1.0)
    return Range(offsets[below - 1], offsets[above - 1], max(below, above) == len(offsets))


def _cannot_tell(search: Search, best: Candidate) -> tuple[str, ...]:
    """Along which directions the returns say nothing."""
    information, units, sentences = search.information(best), search.units, []
    strengths, ways = np.linalg.eigh(information[4:6, 4:6])
    if strengths[0] < UNSEEN:
        angle = math.degrees(math.atan2(ways[1, 0], ways[0, 0])) % 180.0
        sentences.append(f"the walls that were seen say nothing along {angle:.0f} degrees of the map")
    if search.speed_mps < SLOWEST_MPS:
        still = "the robot hardly moves: nothing can be said of a scan delay, nor of mount against map"
        return (*sentences, still)
    left, by_mount = _left_over(information, DELAY, MOUNT)
    if left < ALIKE:
        x, y, yaw = (-0.1 * units[3] / units[:3] * by_mount[:, 0]).tolist()
        sentences.append(
            "without turns or changes of speed a scan delay of 0.1 s looks like a mount that is off by "
            f"x {x:z.2f}, y {y:z.2f} m and {math.degrees(yaw):z.1f} degrees"
        )
    if all(_left_over(information, (axis,), MAP)[0] < ALIKE for axis in (0, 1)):
        sentences.append("the heading hardly changes: a mount that is off looks like a map that is moved")
    return tuple(sentences)


def _left_over(information: Floats, what: tuple[int, ...], given: tuple[int, ...]) -> tuple[float, Floats]:
    """The share of what values do to the returns that others cannot do as well, and how these would."""
    own, cross = information[np.ix_(what, what)], information[np.ix_(given, what)]
    by_others = np.linalg.pinv(information[np.ix_(given, given)], rcond=UNSEEN) @ cross
    rest = own - cross.T @ by_others
    return float(np.trace(rest) / max(np.trace(own), 1e-12)), by_others


def line_of(proposal: Proposal, mirrored: bool = False, delay_s: float = 0.0) -> str:
    """What is wrong, the shares before and after, and what corrects it; see :func:`verdict`."""
    found, line = proposal.found, f"{proposal.share_before:.2f} of the returns lie on mapped walls, "
    if not found.kinds:
        return line + "and no other setup does better"
    if not proposal.is_good:
        where = f"is it the map of this place (--map)? {PLACED}"
        return f"{line}and no setup brings more than {found.share:.2f}: {where}"
    what, keys = _in_words(found, mirrored, delay_s)
    line += f"{found.share:.2f} if {what}: {keys}"
    if proposal.alike:
        what, keys = _in_words(proposal.alike[0], mirrored, delay_s)
        line += f"; or, which this recording cannot tell, if {what}"
        line += f": {keys}" if len(line) + len(keys) + 2 < LONGEST_LINE else ""
    return line


def _in_words(found: Candidate, mirrored: bool, delay_s: float) -> tuple[str, str]:
    """What is wrong, and the keys of ``setup.yaml`` that make this setup."""
    kinds, parts, keys = found.kinds, [], []
    (x, y, yaw), degrees = found.mount, math.degrees(found.mount.yaw)
    if found.is_mirrored:
        parts.append("the scans are mirrored")
        keys.append(f"mirrored: {'false' if mirrored else 'true'}")
    elif "turn" in kinds:
        parts.append(f"the scans are turned by {90 * found.quarter_turns} degrees")
    elif "mount" in kinds:
        parts.append(f"the laser sits at x {x:z.2f}, y {y:z.2f} m, {degrees:z.1f} degrees on the robot")
    if {"mount", "turn"} & {*kinds}:
        keys.append(f"mount: [{x:z.3f}, {y:z.3f}, {degrees:z.1f}]")
    if "delay" in kinds:
        late = "late" if found.delay_s > 0.0 else "early"
        parts.append(f"the scans come {abs(found.delay_s):.2f} s {late}")
        keys.append(f"delay_s: {delay_s + found.delay_s:z.3f}")
    if "map" in kinds:
        x, y, yaw = found.map_moved
        turned = f" and turned by {math.degrees(yaw):.0f} degrees" if abs(yaw) >= math.radians(2.0) else ""
        parts.append(f"the map is moved by x {x:z.2f}, y {y:z.2f} m{turned} against the poses")
        keys.append(f"start: {start_of(found)}")
    return " and ".join(parts), "; ".join(keys)


def start_of(found: Candidate) -> list[float]:
    """[x, y, yaw_deg] of key ``start``, exact enough for a map of 100 m."""
    x, y, yaw = found.start
    return [round(x, 3), round(y, 3), round(math.degrees(wrap_angle(yaw)), 2)]


def _start_in_words(found: Candidate) -> str:
    x, y, yaw_deg = start_of(found)
    return f"[{x:z.2f}, {y:z.2f}, {yaw_deg:z.1f}]"


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
    samples, moved = samples_of(recorded, robot, setup), AT_ORIGIN
    if not samples:
        raise InputError(f"start: {robot.name}: no scan of it has a pose; see 'midnet-bench replay FILE'")
    if not isinstance(start, str):
        x, y, yaw_deg = start
        moved = Pose2D(x, y, math.radians(yaw_deg)).compose(samples[0].pose.inverse())
        samples = samples_of(recorded, robot.moved(moved), setup)
    search = Search(samples, FULL_BEAMS, Walls(prior_map))
    found, others = _anywhere(search) if start == FOUND else (_near(search), [])
    if start == FOUND and found.share < POOR:
        raise InputError(
            f"start: {robot.name}: no place of the map brings more than {found.share:.2f} of the returns "
            "onto walls; is it the map of this place (--map), and the mount right (--mount)? Else give "
            "--start X,Y,YAW_DEG"
        )
    place = _start_in_words(found)
    note(f"{robot.name}: began at start: {place} on the map; {found.share:.2f} of the returns lie on walls")
    for other in others:
        note(
            f"{robot.name}: {other.share:.2f} do from {_start_in_words(other)}, too: the recording does not "
            "tell the two apart; --start says which"
        )
    if found.share < GOOD:
        note(f"{robot.name}: few returns for the right place; --check looks for the mount as well")
    return found.map_moved.compose(moved)


def _near(search: Search) -> Candidate:
    """The place near where the poses are now by which more returns lie on walls; it itself if none is."""
    here = search.as_set
    better = search.refined(here, MAP)
    return better if better.share >= here.share and better.score > here.score else here


def _anywhere(search: Search) -> tuple[Candidate, list[Candidate]]:
    """The best place of all, and another one that is as good within noise, if there is one."""
    best, *others = search.places()
    least = best.score - max(WORTH, search.noise)

    def is_apart(other: Candidate) -> bool:
        x, y, turn = (other.values - best.values)[list(MAP)].tolist()
        return math.hypot(x, y) > APART_M or abs(wrap_angle(turn)) > APART_RAD

    return best, [each for each in others if each.score >= least and is_apart(each)][:1]
