"""``LidarSensors``: the robots' LiDARs in a simulated world, what their beams meet and their noise.

Walls and stationary intruders are met by the simulator's rays. Other robots are discs in the scan plane and
are intersected here: PyBullet's own ray against a round shape errs by up to 9 mm at its edge, disagrees
on hit or miss for one beam in a hundred that passes near it, and costs four times as much as the walls.
"""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from numba import njit

from midnet_bench.arena.free_space import cells_near
from midnet_bench.geometry import Box, Pose2D
from midnet_bench.rng import stream
from midnet_bench.simulation.settings import LidarNoise, LidarSettings
from midnet_bench.simulation.simulator import Beams, Simulator

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

NOTHING, SOLID = -1, -2
"""What a beam met that was no robot: nothing, a wall or a stationary intruder."""


@njit(cache=True)
def beam_directions(poses: Floats, ahead_m: float, cosines: Floats, sines: Floats) -> tuple[Floats, Floats]:
    """(m, 2) axes ``ahead_m`` before (m, 3) poses and (m, beams, 2) unit vectors, in the poses' frame.

    ``cosines``, ``sines``: (beams,) of the beams' angles in the robot's frame.
    """
    axes = np.empty((len(poses), 2))
    directions = np.empty((len(poses), len(cosines), 2))
    for i in range(len(poses)):
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        axes[i, 0] = poses[i, 0] + ahead_m * c
        axes[i, 1] = poses[i, 1] + ahead_m * s
        for k in range(len(cosines)):
            directions[i, k, 0] = c * cosines[k] - s * sines[k]
            directions[i, k, 1] = s * cosines[k] + c * sines[k]
    return axes, directions


@njit(cache=True)
def reported(
    ranges: Floats,
    errors: Floats,
    scales: Floats,
    sigma_m: float,
    sigma_share: float,
    near_m: float,
    limits_m: tuple[float, float],
) -> Floats:
    """(m, beams) ranges with noise, clamped to the sensor's limits; inf stays inf.

    ``errors``: (m, beams) standard normal; ``scales``: (m,) factors, applied first. The standard deviation is
    ``sigma_m`` below ``near_m`` and ``sigma_share`` of the range from there on.
    """
    noisy = np.empty_like(ranges)
    for i in range(ranges.shape[0]):
        for k in range(ranges.shape[1]):
            scaled = ranges[i, k] * scales[i]
            if scaled == np.inf:
                noisy[i, k] = np.inf
                continue
            sigma = sigma_m if scaled < near_m else sigma_share * scaled
            noisy[i, k] = min(max(scaled + sigma * errors[i, k], limits_m[0]), limits_m[1])
    return noisy


@njit(cache=True)
def hide_behind_discs(
    ranges: Floats,
    axes: Floats,
    directions: Floats,
    poses: Floats,
    ahead_m: float,
    radii_m: Floats,
    own: Ints,
    far_m: float,
) -> Ints:
    """(m, beams) what each beam meets first: a disc's number, ``SOLID`` or ``NOTHING``.

    ``ranges``: (m, beams) to the nearest solid, inf for none; shortened where a disc within ``far_m`` is
    nearer. The discs lie ``ahead_m`` before the (n, 3) poses, NaN for one that is not there, and have
    ``radii_m``, (n,); sensor i does not see disc ``own[i]``. The solid, then the lower number wins a tie.
    """
    sensors, beams = directions.shape[:2]
    met = np.empty((sensors, beams), dtype=np.int64)
    centers = np.empty((len(poses), 2))
    for disc in range(len(poses)):
        centers[disc, 0] = poses[disc, 0] + ahead_m * math.cos(poses[disc, 2])
        centers[disc, 1] = poses[disc, 1] + ahead_m * math.sin(poses[disc, 2])
    for i in range(sensors):
        for k in range(beams):
            met[i, k] = NOTHING if ranges[i, k] == np.inf else SOLID
        for disc in range(len(poses)):
            dx, dy = centers[disc, 0] - axes[i, 0], centers[disc, 1] - axes[i, 1]
            if disc == own[i] or not math.hypot(dx, dy) < far_m + radii_m[disc]:
                continue
            beside = radii_m[disc] * radii_m[disc] - dx * dx - dy * dy
            for k in range(beams):
                along = dx * directions[i, k, 0] + dy * directions[i, k, 1]
                under_root = along * along + beside
                if along > 0.0 and under_root > 0.0:
                    distance = along - math.sqrt(under_root)
                    if distance < far_m and distance < ranges[i, k]:
                        ranges[i, k] = distance
                        met[i, k] = disc
    return met


TOO_NEAR_M = 0.0
"""The range of a beam that ends before the sensor's least range, as the LDS-01's driver reports it."""

_BLIND_M = 0.20
"""No solid this far from the middle of the axle's cell can be within the sensor's least range."""


class LidarSensors:
    """The LiDARs of all robots of a simulator. All beams of a scan leave at one instant.

    They are horizontal, from yaw alone: a real sensor nods with its robot by a fraction of a degree.
    """

    def __init__(self, simulator: Simulator, settings: LidarSettings | None = None) -> None:
        settings = settings or LidarSettings()
        robot, layout = simulator.robot, simulator.layout
        self._simulator = simulator
        self._lidar = robot.lidar
        self._disc = robot.profiles[settings.robot_profile]
        robots, intruders = len(layout.robots), len(layout.intruders)
        self._radii_m = self._disc.radius_m * np.repeat([1.0, layout.mobile_scale], [robots, intruders])
        self._noise = settings.noise
        self._dropout = settings.dropout
        angles_rad = self._lidar.mount.yaw + self._lidar.angles_rad
        self._cosines, self._sines = np.cos(angles_rad), np.sin(angles_rad)
        # Named by side, so that an intruder's sensor does not change with the size of the team.
        owners = [("robot", i) for i in range(robots)] + [("intruder", i) for i in range(intruders)]
        self._scales = np.array(
            [draw_scale(stream(layout.seed, "lidar scale", side, i)) for side, i in owners]
        )
        self._dropout_rngs = [stream(layout.seed, "lidar dropout", side, i) for side, i in owners]
        self._blind_cells = cells_near(layout.arena, layout.solids, _BLIND_M)

    def scan(self, indices: Sequence[int], rngs: Sequence[np.random.Generator]) -> Floats:
        """(len(indices), beams) ranges of those robots' LiDARs at this tick, metres.

        inf where nothing reflects within range or the beam drops out; 0 (``TOO_NEAR_M``) where something
        stands closer than the sensor's least range. ``rngs`` are the robots' noise generators, one per index.
        """
        ranges = self.scan_and_bodies(indices, rngs)[0]
        if self._dropout > 0.0:
            for row, index in enumerate(indices):
                ranges[row, self._dropout_rngs[index].random(ranges.shape[1]) < self._dropout] = np.inf
        return ranges

    def scan_and_bodies(
        self, indices: Sequence[int], rngs: Sequence[np.random.Generator]
    ) -> tuple[Floats, Ints]:
        """What ``scan`` gives, and beside it which robot each beam met, both (len(indices), beams).

        ``SOLID`` where it met a wall or a stationary intruder, ``NOTHING`` where it met nothing. No beam
        drops out here: this is what could be seen.

        Raises:
            ValueError: one of these robots was removed.
        """
        rows = list(indices)
        active = self._simulator.active
        for row in rows:
            if not active[row]:
                raise ValueError(f"robot {row} is not in this world: it was removed")
        low, high = self._lidar.range_min_m, self._lidar.range_max_m
        poses = self._simulator.poses()
        beams = Beams(*beam_directions(poses[rows], self._lidar.mount.x, self._cosines, self._sines))
        true_ranges = self._simulator.cast(beams, low, high)
        for row in self._near_solids(rows):
            # The rays above start past the sensor's housing; what stands nearer needs rays of its own.
            one = Beams(beams.axes[row : row + 1], beams.directions[row : row + 1])
            true_ranges[row] = np.minimum(true_ranges[row], self._simulator.cast(one, 0.0, low)[0])
        numbers = np.asarray(rows, dtype=np.int64)
        bodies = hide_behind_discs(
            true_ranges, *beams, poses, self._disc.offset_x_m, self._radii_m, numbers, high
        )
        ranges = add_noise(true_ranges, self._noise, self._scales[rows], rngs, (low, high))
        ranges[true_ranges < low] = TOO_NEAR_M
        return ranges, np.asarray(bodies)

    def outline(self, index: int) -> Box:
        """The true box, map frame, of what beams see of a robot (item 45); NaN once it is removed."""
        center = self._simulator.pose(index).compose(Pose2D(self._disc.offset_x_m, 0.0, 0.0))
        return Box.square(center.x, center.y, 2.0 * float(self._radii_m[index]))

    def _near_solids(self, rows: list[int]) -> list[int]:
        """Which of ``rows``, by place, may have a solid within their sensor's least range."""
        grid = self._blind_cells
        cells = [grid.cell_at(*self._simulator.pose(row)[:2]) for row in rows]
        return [i for i, cell in enumerate(cells) if grid.contains_cell(*cell) and grid.data[cell[::-1]]]


def add_noise(
    ranges: Floats,
    noise: LidarNoise,
    scales: Floats,
    rngs: Sequence[np.random.Generator],
    limits_m: tuple[float, float],
) -> Floats:
    """Ranges as the sensor reports them; rows are robots. Beams without a return stay inf.

    ``gazebo`` adds a normal error of 10 mm at every range. ``datasheet`` reads the maker's precision
    (10 mm below 0.5 m, 3.5 % above) as three standard deviations, and its accuracy as ``scales``: (m,)
    factors that belong to each sensor. Returns are clamped to ``limits_m``, the sensor's own. Each robot's
    generator gives one number per beam, whatever the beams meet.
    """
    if noise == "none":
        return ranges
    errors = np.array([rng.standard_normal(ranges.shape[1]) for rng in rngs]).reshape(ranges.shape)
    if noise == "gazebo":
        return np.asarray(reported(ranges, errors, np.ones(len(ranges)), 0.010, 0.0, math.inf, limits_m))
    return np.asarray(reported(ranges, errors, scales, 0.010 / 3.0, 0.035 / 3.0, 0.5, limits_m))


def draw_scale(rng: np.random.Generator) -> float:
    """One sensor's factor of systematic error: the maker's accuracy of 5 % as three standard deviations."""
    return float(np.clip(rng.normal(1.0, 0.05 / 3.0), 0.95, 1.05))
