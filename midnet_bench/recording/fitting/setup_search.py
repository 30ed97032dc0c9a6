"""The search for the setup by which scans lie on a map's walls: least squares on a likelihood field.

A setup is eight values: the sensor's x, y, yaw on the robot; by how much a scan's time is later than its
instant; the map's x, y, yaw; the factor of all ranges.
"""

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from midnet_bench.geometry import Floats, Pose2D, wrap_angle
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.fitting.fit import Points, Sample, Walls

MOUNT, DELAY, MAP, FACTOR = (0, 1, 2), (3,), (4, 5, 6), (7,)
"""numbers of the values that a hypothesis may change"""
LARGEST_DELAY_S, DELAY_STEP_S = 0.5, 0.02
FAR_M = 1.0  # so far, along x and y, a moved map is looked for at first, in steps of a third of it
LARGEST_PICTURE_M = 400.0
"""from the middle of a robot's ways: a Fourier transform of a larger picture takes gigabytes"""
TURNS = np.arange(72) * (math.tau / 72)
STEPS_APART = 4  # of the starts of one search: nearer ones end in one place
COARSE_M, NARROW_M = 0.3, 0.06  # Distance to a wall at which a return counts half, of starts and of scores.
SCALES_M = (COARSE_M, 0.04)
"""the same of the least squares, one after the other; the last is chosen in docs/studies/recordings-fit.md"""
SETTLED = 0.01  # a step by so small a part of all that a value has moved is the last
START_RETURNS = 3  # starts are compared by one return in so many
HELD = 0.004
"""A direction that no larger share of the returns constrains stays as it is: beside a wall, at rest."""
CORRELATED_BEAMS = 10.0
"""Returns that count as one independent draw: neighbours meet the same wall (``ScanToMap``)."""
SLOWEST_MPS = 0.05  # where returns move more slowly than this over the map, nothing is said of the time


class Candidate(NamedTuple):
    """A setup, and how the returns lie by it."""

    changed: tuple[int, ...]  # the values that it may differ in from what was set
    values: Floats  # (8,)
    is_mirrored: bool  # whether the beams go round the other way than the samples' geometry says
    share: float  # of the search's returns that lie on walls
    score: float  # the same, smooth: mean of :func:`closeness`
    turned_rad: float  # by how much the sensor is turned against the one that was set, within [-pi, pi)
    map_moved: Pose2D  # where the frame of the poses lies in that of the map; all zero where the two are one
    start: Pose2D  # where the robot was at the first scan, in the frame of a map that is moved so

    @property
    def mount(self) -> Pose2D:
        """The sensor in the robot's frame."""
        x, y, yaw = self.values[:3].tolist()
        return Pose2D(x, y, wrap_angle(yaw))

    @property
    def delay_s(self) -> float:
        """By how much a scan's time is later than the instant at which it was measured."""
        return float(self.values[3])

    @property
    def quarter_turns(self) -> int:
        """-1, 0, 1 or 2 quarter turns, whichever the sensor's turn is nearest to."""
        return (round(self.turned_rad / (math.pi / 2.0)) + 1) % 4 - 1

    @property
    def kinds(self) -> tuple[str, ...]:
        """What differs from what was set, of "mirror", "mount" or "turn", "delay", "map"."""
        mount = "turn" if self.quarter_turns and not self.is_mirrored else "mount"
        found = {mount: MOUNT, "delay": DELAY, "map": MAP}
        return ("mirror",) * self.is_mirrored + tuple(
            kind for kind, own in found.items() if set(own) <= set(self.changed)
        )


class Search:
    """Where the returns of some samples lie by a setup, and the setups by which they lie on walls."""

    def __init__(self, samples: Sequence[Sample], most_beams: int, walls: Walls) -> None:
        """At most ``most_beams`` of a sample, spread evenly over those that met something."""
        self.walls, self._first = walls, samples[0].pose
        ends = []
        for number, sample in enumerate(samples):
            met = sample.ends()
            step = max(math.ceil(len(met) / most_beams), 1)
            ends.append(met[number % step :: step])
        self._owners = np.repeat(np.arange(len(ends)), [len(own) for own in ends])
        self._ends = _points(np.concatenate(ends))
        steps = math.ceil(LARGEST_DELAY_S / DELAY_STEP_S) + 2
        self._delays_s: Floats = np.arange(-steps, steps + 1, dtype=np.float64) * DELAY_STEP_S
        delays_ns = np.rint(self._delays_s * NS).astype(np.int64)
        poses = np.array([sample.track.at_times(sample.time_ns - delays_ns) for sample in samples])
        poses[:, :, 2] = np.unwrap(poses[:, :, 2], axis=1)
        self._poses = poses
        self._middle = complex(*poses[:, steps, :2].mean(axis=0))
        """of the robot's ways: a map turns about it here"""
        lever_m = math.sqrt(np.square(np.abs(self._ends)).sum() / max(len(self._ends), 1))
        rates = (poses[:, steps + 1] - poses[:, steps - 1]) / (2.0 * DELAY_STEP_S)
        self.speed_mps = math.sqrt(np.square(rates * (1.0, 1.0, lever_m)).sum(axis=1).mean())
        """how fast returns of still walls move in the robot's frame, root mean square"""
        self.units = np.array([1, 1, lever_m, max(self.speed_mps, SLOWEST_MPS), 1, 1, lever_m, lever_m])
        """(8,) how far a unit of each value moves the returns, metres, typically"""
        self.as_set = self.candidate(np.array([*samples[0].lidar.mount, 0.0, 0.0, 0.0, 0.0, 1.0]))

    @property
    def noise(self) -> float:
        """Two standard deviations of a share of 0.5 to 0.9, by chance alone."""
        return 2.0 * 0.4 / math.sqrt(max(len(self._ends) / CORRELATED_BEAMS, 1.0))

    def place(self, values: Floats, is_mirrored: bool = False) -> Floats:
        """(n, 2) where the returns lie, map frame."""
        points, _, _ = self._placed(values, is_mirrored)
        return points.view(np.float64).reshape(-1, 2)

    def _placed(self, values: Floats, is_mirrored: bool) -> tuple[Points, Points, Points]:
        """(n,) each, as x + iy: the returns, metres, map frame; their robots' headings; LiDAR to return."""
        x, y, yaw, delay_s, dx, dy, turn, factor = values.tolist()
        at = (delay_s - self._delays_s[0]) / DELAY_STEP_S
        first = min(max(math.floor(at), 0), len(self._delays_s) - 2)
        poses = self._poses[:, first] + (at - first) * (self._poses[:, first + 1] - self._poses[:, first])
        ends = (np.conj(self._ends) if is_mirrored else self._ends) * cmath.rect(factor, yaw)
        robots = (_points(poses[:, :2]) - self._middle) * cmath.rect(1.0, turn) + complex(dx, dy)
        headings = np.exp(1j * (poses[:, 2] + turn))[self._owners]
        points = (robots + self._middle)[self._owners] + headings * (ends + complex(x, y))
        return points, headings, headings * ends

    def candidate(
        self, values: Floats, is_mirrored: bool = False, changed: tuple[int, ...] = ()
    ) -> Candidate:
        """What these values are worth."""
        distances_m = self.walls.distances(self.place(values, is_mirrored))
        share, score = np.mean(distances_m <= self.walls.near_m), closeness(distances_m, NARROW_M).mean()
        turn = wrap_angle(float(values[6]))
        shift = self._middle * (1.0 - cmath.rect(1.0, turn)) + complex(*values[4:6])
        moved = Pose2D(shift.real, shift.imag, turn)
        turned_rad = wrap_angle(float(values[2] - self.as_set.values[2])) if changed else 0.0
        start = moved.compose(self._first)
        return Candidate(changed, values, is_mirrored, float(share), float(score), turned_rad, moved, start)

    def refined(
        self, start: Candidate, changed: tuple[int, ...], scales_m: Sequence[float] = SCALES_M
    ) -> Candidate:
        """The best setup near ``start`` of those that differ from it in ``changed``, on these returns."""
        values = start.values
        for scale_m in scales_m if changed else ():
            values = self._fitted(values, list(changed), start.is_mirrored, scale_m)
        return self.candidate(values, start.is_mirrored, tuple(sorted({*start.changed, *changed})))

    def _fitted(self, start: Floats, chosen: list[int], is_mirrored: bool, scale_m: float) -> Floats:
        """(8,) values of which the chosen ones are fitted: the sum of 1 less each closeness is least."""
        held = math.sqrt(HELD * len(self._ends)) / scale_m * np.eye(len(chosen))

        def values(moved_m: Floats) -> Floats:
            moved = start.copy()
            moved[chosen] += moved_m / self.units[chosen]
            moved[3] = np.clip(moved[3], -LARGEST_DELAY_S, LARGEST_DELAY_S)
            return moved

        def residuals(moved_m: Floats) -> Floats:
            ratios = self.walls.distances(self.place(values(moved_m), is_mirrored)) / scale_m
            return np.concatenate((ratios / np.sqrt(1.0 + ratios * ratios), held @ moved_m))

        def slopes(moved_m: Floats) -> Floats:
            return np.concatenate((self._slopes(values(moved_m), chosen, is_mirrored, scale_m), held))

        none, ftol = np.zeros(len(chosen)), SETTLED * SETTLED
        return values(least_squares(residuals, none, slopes, method="lm", xtol=SETTLED, ftol=ftol).x)

    def _slopes(self, values: Floats, chosen: Sequence[int], is_mirrored: bool, scale_m: float) -> Floats:
        """(n, k) of the residuals, whose squares are 1 less each closeness, for a metre of each value."""
        points, headings, from_sensor = self._placed(values, is_mirrored)
        distances_m, slopes = self.walls.read(points.view(np.float64).reshape(-1, 2))
        squared = 1.0 + np.square(distances_m / scale_m)
        against = np.conj(slopes) / (scale_m * squared * np.sqrt(squared))
        delayed = values + 1e-3 * (np.arange(8) == DELAY)
        later = self._placed(delayed, is_mirrored)[0] if 3 in chosen else points
        late, turned = (later - points) * 1e3, 1j * (points - self._middle - complex(*values[4:6]))
        ways = headings, 1j * headings, 1j * from_sensor, late, 1.0, 1j, turned, from_sensor / values[7]
        # the real part of conj(slope) * way is the scalar product of the two
        return np.stack([(against * ways[k]).real / self.units[k] for k in chosen], axis=1)

    def information(self, candidate: Candidate) -> Floats:
        """(8, 8) of the values, in the returns' own metres: 1 where all returns are constrained."""
        slopes = self._slopes(candidate.values, range(8), candidate.is_mirrored, NARROW_M)
        # a return on a wall holds the map's place along the wall's normal by its whole weight
        return np.asarray(slopes.T @ slopes / max(float(np.square(slopes[:, 4:6]).sum()), 1e-9))

    def turned(self, is_mirrored: bool) -> Candidate:
        """Another mount, turned by any angle; ``is_mirrored``: and the beams the other way round."""
        offsets = np.zeros((len(TURNS), 8))
        offsets[:, 2] = TURNS
        plain = [] if is_mirrored else [self.as_set]
        return self._best(MOUNT, [*plain, *self._starts(offsets, is_mirrored)])

    def moved(self) -> Candidate:
        """The map moved by up to about ``FAR_M`` along x and y, and turned a little."""
        steps = np.linspace(-FAR_M, FAR_M, 7)
        offsets = np.zeros((49, 8))
        offsets[:, 4:6] = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        return self._best(MAP, self._starts(offsets))

    def late(self) -> Candidate:
        """The scans late or early."""
        offsets = np.zeros((11, 8))
        offsets[:, 3] = np.linspace(-LARGEST_DELAY_S, LARGEST_DELAY_S, 11)
        return self._best(DELAY, self._starts(offsets))

    def places(self, is_mirrored: bool = False) -> list[Candidate]:
        """The map moved by any distance and turned by any angle: the best first, three turns apart."""
        tried = [self.refined(start, MAP) for start in self._overlaps(is_mirrored)]
        return sorted(tried, key=lambda each: -each.score)

    def _best(self, changed: tuple[int, ...], starts: Sequence[Candidate]) -> Candidate:
        return max((self.refined(start, changed) for start in starts), key=lambda each: each.score)

    def _starts(self, offsets: Floats, is_mirrored: bool = False) -> list[Candidate]:
        """The two best of what is set with (n, 8) offsets."""
        values = self.as_set.values + offsets
        placed = (self.place(one, is_mirrored)[::START_RETURNS] for one in values)
        scores = np.array([closeness(self.walls.distances(points), COARSE_M).mean() for points in placed])
        return [self.candidate(values[k], is_mirrored) for k in _best_apart(scores, 2)]

    def _overlaps(self, is_mirrored: bool) -> list[Candidate]:
        """Where a coarse picture of the returns overlaps most with one of the walls, three turns apart."""
        from scipy.signal import fftconvolve  # half a second, which a setup that fits does not need

        points = _points(self.place(self.as_set.values, is_mirrored)) - self._middle
        reach_m = float(np.abs(points).max(initial=0.0))
        if reach_m > LARGEST_PICTURE_M:  # poses that jump far off: most returns must do
            reach_m = min(float(np.quantile(np.abs(points), 0.9)), LARGEST_PICTURE_M)
        resolution_m = self.walls.grid.resolution
        coarse = max(4, round(0.2 / resolution_m))
        cell_m = coarse * resolution_m
        half = math.ceil(reach_m / cell_m)
        edges = (np.arange(2 * half + 2) - half - 0.5) * cell_m  # the robot's middle is in the middle cell
        near = closeness(self.walls.distances_m[::coarse, ::coarse], COARSE_M)
        near -= near.mean()
        scores, found = np.zeros(len(TURNS)), np.tile(self.as_set.values, (len(TURNS), 1))
        for k, turn in enumerate(TURNS.tolist()):
            turned = points * cmath.rect(1.0, turn)
            picture, _, _ = np.histogram2d(turned.imag, turned.real, bins=(edges, edges))
            overlap = fftconvolve(near, picture[::-1, ::-1])
            row, column = np.unravel_index(int(np.argmax(overlap)), overlap.shape)
            x, y = np.array([column - half, row - half]) * cell_m + self.walls.first_center
            scores[k] = overlap[row, column]
            found[k, 4:7] = x - self._middle.real, y - self._middle.imag, wrap_angle(turn)
        return [self.candidate(found[k], is_mirrored) for k in _best_apart(scores, 3)]


def closeness(distances_m: Floats, half_m: float) -> Floats:
    """How well returns at these distances lie on walls: 1 on them, a half at ``half_m``."""
    return np.asarray(1.0 / (1.0 + np.square(distances_m / half_m)))


def _best_apart(scores: Floats, most: int) -> list[int]:
    """Indices of the best scores on a circle, none beside a better one."""
    chosen: list[int] = []
    half = len(scores) // 2
    for k in np.argsort(-scores, kind="stable").tolist():
        away = (abs((k - other + half) % len(scores) - half) > STEPS_APART for other in chosen)
        if len(chosen) < most and all(away):
            chosen.append(k)
    return chosen


def _points(pairs: Floats) -> Points:
    return np.ascontiguousarray(pairs).view(np.complex128)[:, 0]
