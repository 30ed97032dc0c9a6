"""The search for the setup (mount, mirror, delay, place of the map) by which scans lie on a map's walls."""

import cmath
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.geometry import Pose2D, wrap_angle
from midnet_bench.recording.files.readings import NS
from midnet_bench.recording.fitting.fit import Sample, Walls

Floats = npt.NDArray[np.float64]
Points = npt.NDArray[np.complex128]
"""(n,) x + iy, metres: a turn is one product, and the work of a search a third"""

MOUNT, DELAY, MAP, FACTOR = (0, 1, 2), (3,), (4, 5, 6), (7,)
"""numbers of the parameters that a hypothesis may change: the sensor's x, y, yaw on the robot; by how much a
scan's time is later than its instant; the map's x, y, yaw; the factor of all ranges"""
LARGEST_DELAY_S = 0.5
_DELAY_STEP_S = 0.02
FAR_M = 1.0  # so far, along x and y, a moved map is looked for at first, in steps of a quarter of it
LARGEST_PICTURE_M = 400.0
"""from the middle of a robot's ways: a Fourier transform of a larger picture takes gigabytes"""
_TURN_STEPS = 72
COARSE_M, WIDE_M, NARROW_M = 0.3, 0.4, 0.06
"""Distance to a wall at which a return counts half, while whole turns and places are tried, and a quarter,
at the first step of a refinement and, as the steps narrow down, at its last."""
MOST_ROUNDS = 24
SETTLED_M = 2e-4  # a shorter step, as the returns move by it, ends a refinement
LONGEST_STEP_M = 0.3
SEEN = 0.01
"""A direction that no larger share of the returns constrains stays as it is: beside a wall, at rest."""
CORRELATED_BEAMS = 10.0
"""Returns that count as one independent draw: neighbours meet the same wall (``ScanToMap``)."""
SLOWEST_MPS = 0.05  # where returns move more slowly than this over the map, nothing is said of the time


class Returns:
    """The returns of some samples in one table, and where each of them lies by a setup."""

    def __init__(self, samples: Sequence[Sample], most_beams: int) -> None:
        """At most ``most_beams`` of a sample, spread evenly over those that met something."""
        self.first = samples[0].pose
        """of the robot at the first sample"""
        ends = []
        for number, sample in enumerate(samples):
            met = sample.ends()
            step = max(math.ceil(len(met) / most_beams), 1)
            ends.append(met[number % step :: step])
        self._owners = np.repeat(np.arange(len(ends)), [len(own) for own in ends])
        plain = np.concatenate(ends)
        self._ends = _points(plain)
        steps = math.ceil(LARGEST_DELAY_S / _DELAY_STEP_S) + 2
        self._delays_s: Floats = np.arange(-steps, steps + 1, dtype=np.float64) * _DELAY_STEP_S
        delays_ns = np.rint(self._delays_s * NS).astype(np.int64)
        self._poses = np.array([sample.track.at_times(sample.time_ns - delays_ns) for sample in samples])
        self._poses[:, :, 2] = np.unwrap(self._poses[:, :, 2], axis=1)
        self.middle = self._poses[:, steps, :2].mean(axis=0)
        """(2,) of the robot's ways, metres: a map turns about it here"""
        lever = math.sqrt(np.square(plain).sum() / max(len(plain), 1))
        """root mean square of the ranges"""
        rates = self._rates(0.0)
        self.speed_mps = math.sqrt(
            np.square(rates[:, :2]).sum(axis=1).mean() + np.square(rates[:, 2]).mean() * lever**2
        )
        """how fast returns of still walls move in the robot's frame, root mean square"""
        speed = max(self.speed_mps, SLOWEST_MPS)
        self.units = np.array([1.0, 1.0, lever, speed, 1.0, 1.0, lever, lever])
        """(8,) how far a unit of each parameter moves the returns, metres, typically"""

    def __len__(self) -> int:
        return len(self._ends)

    def _poses_at(self, delay_s: float) -> Floats:
        at = (delay_s - self._delays_s[0]) / _DELAY_STEP_S
        first = min(max(math.floor(at), 0), len(self._delays_s) - 2)
        older, newer = self._poses[:, first], self._poses[:, first + 1]
        return np.asarray(older + (at - first) * (newer - older))

    def _rates(self, delay_s: float) -> Floats:
        """(m, 3) how the samples' poses change with the delay, per second."""
        later, sooner = (self._poses_at(delay_s + step) for step in (_DELAY_STEP_S, -_DELAY_STEP_S))
        return (later - sooner) / (2.0 * _DELAY_STEP_S)

    def place(self, values: Floats, mirrored: bool) -> Floats:
        """(n, 2) where the returns lie, map frame, by the (8,) values of the parameters."""
        robots, headings, on_robot, mount = self._place(values, mirrored)
        return _pairs(robots + headings * (on_robot + mount))

    def _place(self, values: Floats, mirrored: bool) -> tuple[Points, Points, Points, complex]:
        """Of each return its robot and heading, map frame, and itself from the sensor; the sensor's place."""
        x, y, yaw, delay_s, dx, dy, turn, factor = values.tolist()
        poses = self._poses_at(delay_s)
        on_robot = (np.conj(self._ends) if mirrored else self._ends) * cmath.rect(factor, yaw)
        headings = np.exp(1j * (poses[:, 2] + turn))
        middle = complex(*self.middle)
        robots = (_points(poses[:, :2]) - middle) * cmath.rect(1.0, turn) + middle + complex(dx, dy)
        return robots[self._owners], headings[self._owners], on_robot, complex(x, y)

    def moves(
        self, values: Floats, mirrored: bool, changed: Sequence[int] = range(8)
    ) -> tuple[Floats, Floats]:
        """(n, 2) as :meth:`place` has it, and (n, 2, k) how each return moves with each of k parameters."""
        robots, headings, on_robot, mount = self._place(values, mirrored)
        from_sensor, from_robot = headings * on_robot, headings * (on_robot + mount)
        points, late = robots + from_robot, 0.0
        if 3 in changed:
            rates = self._rates(float(values[3]))
            along = _points(rates[:, :2]) * cmath.rect(1.0, float(values[6]))
            late = along[self._owners] + 1j * rates[self._owners, 2] * from_robot
        about = 1j * (points - complex(*(self.middle + values[4:6])))
        ways = (headings, 1j * headings, 1j * from_sensor, late, 1.0, 1j, about, from_sensor / values[7])
        moves = np.empty((len(changed), len(points)), dtype=np.complex128)
        for row, number in zip(moves, changed, strict=True):
            row[:] = ways[number]
        return _pairs(points), np.stack((moves.real, moves.imag)).transpose(2, 0, 1)

    def map_moved(self, values: Floats) -> Pose2D:
        """Where the frame of the poses lies in that of the map; all zero where the two are one."""
        dx, dy, turn = values[4:7].tolist()
        x, y = (_turned(-self.middle[None], turn)[0] + self.middle + (dx, dy)).tolist()
        return Pose2D(x, y, wrap_angle(turn))


class Candidate(NamedTuple):
    """A setup as the search keeps it."""

    changed: tuple[int, ...]  # the parameters that it may differ in from what was set
    values: Floats  # (8,)
    mirrored: bool
    share: float  # of the search's returns that lie on walls
    score: float  # the same, smooth: mean of 1 / (1 + (distance / ``NARROW_M``)^2)


class Search:
    """Tries what could be wrong, one thing at a time, on a few hundred to some thousand returns."""

    def __init__(self, returns: Returns, walls: Walls, as_set: Pose2D) -> None:
        """``as_set``: the mount that is believed so far."""
        self.returns, self.walls = returns, walls
        self._start = np.array([*as_set, 0.0, 0.0, 0.0, 0.0, 1.0])

    @property
    def noise(self) -> float:
        """Two standard deviations of a share of 0.5 to 0.9, by chance alone."""
        return 2.0 * 0.4 / math.sqrt(max(len(self.returns) / CORRELATED_BEAMS, 1.0))

    def candidate(self, changed: tuple[int, ...], values: Floats, mirrored: bool) -> Candidate:
        """What these values are worth."""
        distances_m = self.walls.distances(self.returns.place(values, mirrored))
        share = float(np.mean(distances_m <= self.walls.near_m))
        return Candidate(changed, values, mirrored, share, _score(distances_m, NARROW_M))

    def as_it_is(self) -> Candidate:
        """Nothing changed."""
        return self.candidate((), self._start, False)

    def turned(self, mirrored: bool) -> Candidate:
        """Another mount, turned by any angle; ``mirrored``: and the beams the other way round."""
        turns = np.arange(_TURN_STEPS, dtype=np.float64) * (2.0 * math.pi / _TURN_STEPS)
        starts, scores = self._coarse(2, turns[:, None], mirrored)
        best = int(np.argmax(scores))
        apart = np.abs((np.arange(_TURN_STEPS) - best + _TURN_STEPS // 2) % _TURN_STEPS - _TURN_STEPS // 2)
        second = int(np.argmax(np.where(apart > 4, scores, -1.0)))
        chosen = {best, second} if mirrored else {best, second, 0}
        return self._best(MOUNT, [starts[k] for k in sorted(chosen)], mirrored)

    def moved(self) -> Candidate:
        """The map moved by up to about ``FAR_M`` along x and y, and turned a little."""
        steps = np.linspace(-FAR_M, FAR_M, 9)
        starts, scores = self._coarse(4, np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2))
        return self._best(MAP, [starts[k] for k in np.argsort(-scores, kind="stable")[:2]])

    def late(self) -> Candidate:
        """The scans late or early."""
        starts, scores = self._coarse(3, np.linspace(-LARGEST_DELAY_S, LARGEST_DELAY_S, 21)[:, None])
        return self._best(DELAY, [starts[np.argmax(scores)]])

    def places(self, mirrored: bool = False) -> list[Candidate]:
        """The map moved by any distance and turned by any angle: the best overlaps, three turns apart."""
        return self._tried(MAP, self._overlaps(mirrored), mirrored)

    def refined(self, start: Candidate, changed: tuple[int, ...], wide_m: float = WIDE_M) -> Candidate:
        """The best setup near ``start`` of those that differ from it in ``changed``, on these returns."""
        values = self._refine(start.values, changed, start.mirrored, wide_m) if changed else start.values
        return self.candidate(tuple(sorted({*start.changed, *changed})), values, start.mirrored)

    def information(self, candidate: Candidate) -> Floats:
        """(8, 8) of the parameters, in the returns' own metres: 1 where all returns are constrained."""
        points, moves = self.returns.moves(candidate.values, candidate.mirrored)
        distances_m, slopes = self._read(points)
        weights = _weights(distances_m, NARROW_M)
        rows = np.einsum("nk,nkp->np", slopes, moves) / self.returns.units
        return np.asarray((rows * weights[:, None]).T @ rows / max(weights.sum(), 1e-9))

    def _best(self, changed: tuple[int, ...], starts: Sequence[Floats], mirrored: bool = False) -> Candidate:
        return max(self._tried(changed, starts, mirrored), key=lambda each: each.score)

    def _tried(self, changed: tuple[int, ...], starts: Sequence[Floats], mirrored: bool) -> list[Candidate]:
        refined = [self._refine(start, changed, mirrored, WIDE_M) for start in starts]
        return [self.candidate(changed, values, mirrored) for values in refined]

    def _coarse(self, first: int, added: Floats, mirrored: bool = False) -> tuple[Floats, Floats]:
        """(n, 8) starts with (n, k) values added from parameter ``first`` on, and what each is worth."""
        starts = np.tile(self._start, (len(added), 1))
        starts[:, first : first + added.shape[1]] += added
        placed = (self.returns.place(values, mirrored) for values in starts)
        return starts, np.array([_score(self.walls.distances(points), COARSE_M) for points in placed])

    def _refine(self, start: Floats, changed: tuple[int, ...], mirrored: bool, wide_m: float) -> Floats:
        """Gauss-Newton on the distances to the nearest walls, with weights as in ``ScanToMap``."""
        values, chosen, units = start.copy(), list(changed), self.returns.units[list(changed)]
        narrow_m = max(NARROW_M, self.walls.grid.resolution)
        half_m = max(wide_m, narrow_m)
        for _ in range(MOST_ROUNDS):
            points, moves = self.returns.moves(values, mirrored, chosen)
            distances_m, slopes = self._read(points)
            weights = _weights(distances_m, half_m)
            rows = np.einsum("nk,nkp->np", slopes, moves) / units
            weighted = (rows * weights[:, None]).T / max(weights.sum(), 1e-9)
            strengths, ways = np.linalg.eigh(weighted @ rows)
            along = np.divide(
                ways.T @ (weighted @ distances_m),
                strengths,
                out=np.zeros(len(chosen)),
                where=strengths > SEEN,
            )
            step = ways @ along
            step *= min(LONGEST_STEP_M / max(float(np.abs(step).max()), 1e-12), 1.0)
            values[chosen] -= step / units
            values[3] = min(max(values[3], -LARGEST_DELAY_S), LARGEST_DELAY_S)
            if half_m == narrow_m and np.abs(step).max() < SETTLED_M:
                break
            half_m = max(half_m / 1.5, narrow_m)
        return values

    def _read(self, points: Floats) -> tuple[Floats, Floats]:
        """(n,) distances to the nearest wall and (n, 2) their slopes, read between the cells' centres."""
        field, cell_m = self.walls.distances_m, self.walls.grid.resolution
        x, y = ((points[:, k] - self.walls.corner[k]) / cell_m - 0.5 for k in (0, 1))
        column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        rows, columns = field.shape
        inside = (column >= 0) & (row >= 0) & (column < columns - 1) & (row < rows - 1)
        u, v = np.where(inside, x - column, 0.0), np.where(inside, y - row, 0.0)
        column, row = np.where(inside, column, 0), np.where(inside, row, 0)
        low, high = field[row, column], field[row + 1, column]
        low_rise, high_rise = field[row, column + 1] - low, field[row + 1, column + 1] - high
        low, high = low + u * low_rise, high + u * high_rise
        slopes = np.stack((low_rise + v * (high_rise - low_rise), high - low), axis=1) / cell_m
        distances_m = np.where(inside, low + v * (high - low), self.walls.far_m)
        return distances_m, slopes * inside[:, None]

    def _overlaps(self, mirrored: bool) -> list[Floats]:
        """The values at which a coarse picture of the returns overlaps most with one of the walls.

        One correlation by Fourier transform for each of ``_TURN_STEPS`` turns about the middle of the robot's
        ways; the best of three turns that are apart.
        """
        cell_m = max(4.0 * self.walls.grid.resolution, 0.2)
        points = self.returns.place(self._start, mirrored) - self.returns.middle
        reach = np.abs(points).max() if len(points) else 0.0
        if reach > LARGEST_PICTURE_M:  # poses that jump far off: most returns must do
            reach = min(float(np.quantile(np.abs(points), 0.9)), LARGEST_PICTURE_M)
        size = 2 * math.ceil(reach / cell_m) + 1
        coarse = max(round(cell_m / self.walls.grid.resolution), 1)
        cell_m = coarse * self.walls.grid.resolution
        near = self.walls.distances_m[::coarse, ::coarse].astype(np.float64)
        near = 1.0 / (1.0 + np.square(near / COARSE_M))
        near -= near.mean()
        shape = near.shape[0] + size, near.shape[1] + size
        spectrum = np.fft.rfft2(near, shape)
        found = []
        for number in range(_TURN_STEPS):
            turn = number * (2.0 * math.pi / _TURN_STEPS)
            cells = np.floor(_turned(points, turn) / cell_m + size / 2.0).astype(np.int64)
            picture = np.zeros(shape)
            inside = ((cells >= 0) & (cells < size)).all(axis=1)
            np.add.at(picture, (cells[inside, 1], cells[inside, 0]), 1.0)
            overlap = np.fft.irfft2(spectrum * np.conj(np.fft.rfft2(picture)), shape)
            place = np.unravel_index(int(np.argmax(overlap)), shape)
            row, column = (
                int(k) - side if k >= side - size else int(k) for k, side in zip(place, shape, strict=True)
            )
            # where the picture's middle comes to lie
            at = np.array([column, row]) * cell_m + (size / 2.0) * cell_m + self.walls.corner
            values = self._start.copy()
            values[4:6] = at - self.returns.middle
            values[6] = wrap_angle(turn)
            found.append((float(overlap[place]), number, values))
        found.sort(key=lambda each: (-each[0], each[1]))
        chosen: list[tuple[float, int, Floats]] = []
        for each in found:
            near_turn = (abs((each[1] - other[1] + 36) % _TURN_STEPS - 36) <= 2 for other in chosen)
            if len(chosen) < 3 and not any(near_turn):
                chosen.append(each)
        return [values for _, _, values in chosen]


def _score(distances_m: Floats, half_m: float) -> float:
    return float(np.mean(1.0 / (1.0 + np.square(distances_m / half_m))))


def _weights(distances_m: Floats, half_m: float) -> Floats:
    """Geman-McClure: a quarter at ``half_m``."""
    return np.asarray(1.0 / np.square(1.0 + np.square(distances_m / half_m)))


def _turned(points: Floats, angle_rad: float) -> Floats:
    return _pairs(_points(points) * cmath.rect(1.0, angle_rad))


def _points(pairs: Floats) -> Points:
    return np.ascontiguousarray(pairs).view(np.complex128)[:, 0]


def _pairs(points: Points) -> Floats:
    return np.ascontiguousarray(points).view(np.float64).reshape(-1, 2)
