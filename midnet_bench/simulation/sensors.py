"""A robot's sensors in a simulated world: LiDAR, wheel encoders and IMU, and the noise of each.

Walls and stationary intruders are met by the engine's rays. Other robots are discs in the scan plane and
are intersected here: PyBullet's own ray against a round shape errs by up to 9 mm at its edge, disagrees
on hit or miss for one beam in a hundred that passes near it, and costs four times as much as the walls.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from midnet_bench.arena.free_space import cells_near
from midnet_bench.compiled import njit
from midnet_bench.elementary import cos_sin, directions, hypot, standard_normals
from midnet_bench.geometry import Box, Floats, Indices, Pose2D
from midnet_bench.rng import stream
from midnet_bench.robots.model import RobotModel
from midnet_bench.simulation.engine import Beams
from midnet_bench.simulation.world import World
from midnet_bench.simulation.world_settings import ImuSettings, LidarNoise, LidarSettings, OdometrySettings

Generators = Sequence[np.random.Generator]


class NoiseBlocks:
    """Normal numbers for the readings of n sensors: the same as drawn reading by reading."""

    READINGS = 16  # of a sensor that are drawn at once

    def __init__(self, rngs: Generators, width: int) -> None:
        """One generator for each sensor, which nothing else draws from; ``width`` numbers for a reading."""
        self._rngs = rngs
        self._blocks = np.empty((len(rngs), self.READINGS, width))
        self._used = [self.READINGS] * len(rngs)

    def draw(self, rows: Indices) -> Floats:
        """(m, width) the next reading's numbers of each of ``rows``."""
        drawn = np.empty((len(rows), self._blocks.shape[2]))
        for place, row in enumerate(rows.tolist()):
            if self._used[row] == self.READINGS:
                self._blocks[row] = standard_normals(self._rngs[row], self._blocks[row].shape)
                self._used[row] = 0
            drawn[place] = self._blocks[row, self._used[row]]
            self._used[row] += 1
        return drawn


NOTHING, SOLID = -1, -2  # What a beam met that was no robot: nothing, a wall or a stationary intruder.
TOO_NEAR_M = 0.0
"""The range of a beam that ends before the sensor's least range, as the LDS-01's driver reports it."""


@njit
def beam_directions(poses: Floats, ahead_m: float, cosines: Floats, sines: Floats) -> tuple[Floats, Floats]:
    """(m, 2) axes ``ahead_m`` before (m, 3) poses and (m, beams, 2) unit vectors, in the poses' frame.

    ``cosines``, ``sines``: (beams,) of the beams' angles in the robot's frame.
    """
    axes = np.empty((len(poses), 2))
    directions = np.empty((len(poses), len(cosines), 2))
    for i in range(len(poses)):
        c, s = cos_sin(poses[i, 2])
        axes[i, 0] = poses[i, 0] + ahead_m * c
        axes[i, 1] = poses[i, 1] + ahead_m * s
        for k in range(len(cosines)):
            directions[i, k, 0] = c * cosines[k] - s * sines[k]
            directions[i, k, 1] = s * cosines[k] + c * sines[k]
    return axes, directions


ErrorSizes = tuple[float, float, float]


class Errors(NamedTuple):
    """How a reported range differs from the true one, beside a factor that belongs to the sensor."""

    sigma_m: float  # standard deviation of a range below ``near_m``; 0 for no errors at all
    sigma_share: float  # of a range from there on, as a share of it
    near_m: float
    has_scale: bool  # whether the sensor's factor applies


ERRORS: dict[LidarNoise, Errors] = {
    "gazebo": Errors(0.010, 0.0, math.inf, has_scale=False),
    "datasheet": Errors(0.010 / 3.0, 0.035 / 3.0, 0.5, has_scale=True),
    "none": Errors(0.0, 0.0, math.inf, has_scale=False),
}
"""``gazebo`` adds a normal error of 10 mm at every range. ``datasheet`` reads the maker's precision (10 mm
below 0.5 m, 3.5 % above) as three standard deviations, and its accuracy as each sensor's factor."""


@njit
def reported(
    ranges: Floats, normals: Floats, scales: Floats, errors: ErrorSizes, limits_m: tuple[float, float]
) -> Floats:
    """(m, beams) what sensors report of true ``ranges``.

    ``TOO_NEAR_M`` below the lower limit, inf where nothing was met, else clamped to the limits. ``scales``:
    (m,) factors, applied first; ``errors``: the first three of ``Errors``.
    """
    sigma_m, sigma_share, near_m = errors
    noisy = np.empty_like(ranges)
    for i in range(len(ranges)):
        for k in range(ranges.shape[1]):
            if ranges[i, k] < limits_m[0]:
                noisy[i, k] = TOO_NEAR_M
            elif ranges[i, k] == np.inf:
                noisy[i, k] = np.inf
            else:
                scaled = ranges[i, k] * scales[i]
                sigma = sigma_m if scaled < near_m else sigma_share * scaled
                noisy[i, k] = min(max(scaled + sigma * normals[i, k], limits_m[0]), limits_m[1])
    return noisy


@njit
def hide_behind_discs(
    ranges: Floats,
    axes: Floats,
    directions: Floats,
    poses: Floats,
    ahead_m: float,
    radii_m: Floats,
    own: Indices,
    far_m: float,
) -> Indices:
    """(m, beams) what each beam meets first: a disc's number, ``SOLID`` or ``NOTHING``.

    ``ranges``: (m, beams) to the nearest solid, inf for none; shortened where a disc within ``far_m`` is
    nearer. The discs lie ``ahead_m`` before the (n, 3) poses, NaN for one that is not there, and have
    ``radii_m``, (n,); sensor i does not see disc ``own[i]``. The solid, then the lower number wins a tie.
    """
    sensors, beams = directions.shape[:2]
    met = np.empty((sensors, beams), dtype=np.int64)
    centers = np.empty((len(poses), 2))
    for disc in range(len(poses)):
        c, s = cos_sin(poses[disc, 2])
        centers[disc, 0], centers[disc, 1] = poses[disc, 0] + ahead_m * c, poses[disc, 1] + ahead_m * s
    for i in range(sensors):
        for k in range(beams):
            met[i, k] = NOTHING if ranges[i, k] == np.inf else SOLID
        for disc in range(len(poses)):
            dx, dy = centers[disc, 0] - axes[i, 0], centers[disc, 1] - axes[i, 1]
            if disc == own[i] or not hypot(dx, dy) < far_m + radii_m[disc]:
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


class NoiseFreeScan(NamedTuple):
    """What the beams of m LiDARs met at one instant, before any error of the sensors."""

    beams: Beams
    ranges_m: Floats  # (m, beams); inf where nothing reflects within range
    bodies: Indices  # (m, beams) which robot each beam met, ``SOLID`` or ``NOTHING``

    def of(self, row: int) -> "NoiseFreeScan":
        """That of one LiDAR, m = 1."""
        one = slice(row, row + 1)
        beams = Beams(self.beams.axes[one], self.beams.directions[one])
        return NoiseFreeScan(beams, self.ranges_m[one], self.bodies[one])


_CELL_M = 0.04  # No point of a cell is this far from its middle.


class LidarSensors:
    """The LiDARs of all robots of a world. All beams of a scan leave at one instant.

    They are horizontal, from yaw alone: a real sensor nods with its robot by a fraction of a degree.
    """

    def __init__(self, world: World, settings: LidarSettings | None = None) -> None:
        settings = settings or LidarSettings()
        robot, layout = world.robot, world.layout
        self._world = world
        self._lidar = robot.lidar
        self._disc = robot.disc(settings.robot_profile)
        robots, intruders = len(layout.robots), len(layout.intruders)
        self._radii_m = self._disc.radius_m * np.repeat([1.0, layout.mobile_scale], [robots, intruders])
        self._errors = ERRORS[settings.noise]
        self._dropout = settings.dropout
        angles_rad = self._lidar.mount.yaw + self._lidar.angles_rad
        self._cosines, self._sines = np.ascontiguousarray(directions(angles_rad).T)
        # Named by side, so that an intruder's sensor does not change with the size of the team.
        owners = [("robot", i) for i in range(robots)] + [("intruder", i) for i in range(intruders)]
        self._scales = np.ones(len(owners))
        if self._errors.has_scale:
            scales = [draw_scale(stream(layout.seed, "lidar scale", *owner)) for owner in owners]
            self._scales = np.array(scales)
        self._dropout_rngs = [stream(layout.seed, "lidar dropout", *owner) for owner in owners]
        # farther from the axle's cell no solid can be within the sensor's least range
        blind_m = abs(self._lidar.mount.x) + self._lidar.range_min_m + _CELL_M
        self._blind = cells_near(layout.arena, layout.stationary, blind_m)
        self._to_disc = Pose2D(self._disc.offset_x_m, 0.0, 0.0)
        self.newest: NoiseFreeScan | None = None
        """what the last scan met; for the referee"""

    def noise(self, rngs: Generators) -> NoiseBlocks:
        """Noise for scans, by a generator of each robot."""
        return NoiseBlocks(rngs, self._lidar.beams)

    def scan(
        self, indices: Sequence[int] | Indices, noise: NoiseBlocks, dropouts: Generators | None = None
    ) -> Floats:
        """(len(indices), beams) ranges of those robots' LiDARs at this tick, metres.

        inf where nothing reflects within range or the beam drops out; 0 (``TOO_NEAR_M``) where something
        stands closer than the sensor's least range. ``noise``, of :meth:`noise`, and ``dropouts``: of all
        robots of the world; the sensors' own dropouts unless given.

        Raises:
            ValueError: one of these robots was removed.
        """
        rows = np.asarray(indices, dtype=np.int64)
        self.newest = self.true_scan(rows)
        ranges = self.measured(self.newest.ranges_m, rows, noise)
        rngs = dropouts or self._dropout_rngs
        for own, index in zip(ranges, indices, strict=True):
            if self._dropout > 0.0:
                own[rngs[index].random(len(own)) < self._dropout] = np.inf
        return ranges

    def measured(self, true_ranges: Floats, rows: Indices, noise: NoiseBlocks) -> Floats:
        """(m, beams) what the LiDARs of those robots report of true ranges, inf for nothing; metres.

        Each one's ``noise`` gives a number for each beam. Errors as :class:`Errors` has them.
        """
        limits_m = self._lidar.range_min_m, self._lidar.range_max_m
        if self._errors.sigma_m == 0.0:
            return np.where(true_ranges < limits_m[0], TOO_NEAR_M, true_ranges)
        normals = noise.draw(rows)
        return np.asarray(reported(true_ranges, normals, self._scales[rows], self._errors[:3], limits_m))

    def true_scan(self, rows: Indices) -> NoiseFreeScan:
        """What the beams of those robots meet at this tick. Raises ValueError if one was removed."""
        low, high = self._lidar.range_min_m, self._lidar.range_max_m
        poses = self._world.poses()
        own = poses[rows]
        for row, (x, _, _) in zip(rows, own.tolist(), strict=True):
            if math.isnan(x):
                raise ValueError(f"robot {row} is not in this world: it was removed")
        beams = Beams(*beam_directions(own, self._lidar.mount.x, self._cosines, self._sines))
        ranges = self._world.cast(beams, low, high)
        blind, (left_m, low_m) = self._blind, self._blind.origin
        for i, (x, y, _) in enumerate(own.tolist()):
            row, column = (math.floor(d / blind.resolution) for d in (y - low_m, x - left_m))
            if (
                0 <= row < blind.data.shape[0]
                and 0 <= column < blind.data.shape[1]
                and blind.data[row, column]
            ):
                # The rays above start past the sensor's housing; what stands nearer needs rays of its own.
                one = Beams(beams.axes[i : i + 1], beams.directions[i : i + 1])
                ranges[i] = np.minimum(ranges[i], self._world.cast(one, 0.0, low)[0])
        bodies = hide_behind_discs(ranges, *beams, poses, self._disc.offset_x_m, self._radii_m, rows, high)
        return NoiseFreeScan(beams, ranges, bodies)

    def centers(self, poses: Floats) -> Floats:
        """(n, 2) the middles of what beams see of robots at (n, 3) poses, map frame, metres."""
        return np.array([Pose2D(*pose).compose(self._to_disc)[:2] for pose in poses.tolist()]).reshape(-1, 2)

    def outline(self, index: int) -> Box:
        """The true box, map frame, of what beams see of a robot (item 45); NaN once it is removed."""
        center = self._world.pose(index).compose(self._to_disc)
        return Box.square(center.x, center.y, 2.0 * float(self._radii_m[index]))


def draw_scale(rng: np.random.Generator) -> float:
    """One sensor's factor of systematic error: the maker's accuracy of 5 % as three standard deviations."""
    return float(np.clip(1.0 + 0.05 / 3.0 * standard_normals(rng, (1,)).item(), 0.95, 1.05))


GYRO_STDDEV_RADPS, GYRO_BIAS_RADPS, GYRO_BIAS_STDDEV_RADPS = 2e-4, 7.5e-6, 8e-7
"""turtlebot3_burger.gazebo.xacro, imu, rate: stddev, bias_mean and bias_stddev"""


class ImuSensors:
    """The gyroscopes of n robots.

    ``gazebo`` takes the noise and bias that the Burger's description states. Gazebo's ROS 1 plugin read
    another key and published none of it, which is ``none``. A bias may have either sign. Yaw is the true one
    plus the integral of the gyroscope's errors, as of a filter that has nothing else to go by.
    """

    def __init__(self, settings: ImuSettings, rngs: Generators) -> None:
        """One generator for each robot, which gives its bias first and then its noise.

        It gives two numbers for each: the second was an accelerometer's, which no filter read.
        """
        signs = np.array([rng.choice((-1.0, 1.0), size=2)[0] for rng in rngs])
        draws = np.array([standard_normals(rng, (2,))[0] for rng in rngs])
        self._biases = signs * (GYRO_BIAS_RADPS + GYRO_BIAS_STDDEV_RADPS * draws)
        self._noise = NoiseBlocks(rngs, 2) if settings.noise == "gazebo" else None
        self._drifts = np.zeros(len(rngs))
        """(n,) the integral of each yaw rate's errors, radians"""
        self._readings = np.full((len(rngs), 2), np.nan)

    def read(self, rows: Indices, poses: Floats, velocities: Floats, elapsed_s: float) -> Floats:
        """(n, 2) yaw (rad) and yaw rate (rad/s): new in ``rows``, else the last.

        Given the truth now, ``elapsed_s`` after the last reading: (n, 3) poses, (n, 2) forward speeds and yaw
        rates.
        """
        if self._noise is None:
            self._readings[rows] = np.column_stack((poses[rows, 2], velocities[rows, 1]))
        else:
            truth, noise = (poses, velocities), self._noise.draw(rows)
            add_gyro_errors(rows, truth, elapsed_s, noise, self._biases, self._drifts, self._readings)
        return self._readings


@njit
def add_gyro_errors(
    rows: Indices,
    truth: tuple[Floats, Floats],
    elapsed_s: float,
    normals: Floats,
    biases: Floats,
    drifts: Floats,
    readings: Floats,
) -> None:
    """Put the yaws and yaw rates of ``rows`` into ``readings``, and what their errors add into ``drifts``.

    ``truth``: (n, 3) poses and (n, 2) velocities; ``normals``: (m, 2), of which the second is not used.
    """
    poses, velocities = truth
    for i in range(len(rows)):
        row = rows[i]
        error = biases[row] + GYRO_STDDEV_RADPS * normals[i, 0]
        drifts[row] += error * elapsed_s
        readings[row, 0] = (poses[row, 2] + drifts[row] + math.pi) % (2.0 * math.pi) - math.pi
        readings[row, 1] = velocities[row, 1] + error


TICK_RAD = 2.0 * math.pi / 4096  # The least turn of a wheel that its encoder tells apart.


class EncoderOdometers:
    """Dead reckoning of n robots from their wheels' angles."""

    def __init__(
        self,
        starts: Floats,
        wheel_angles_rad: Floats,
        settings: OdometrySettings,
        rngs: Generators,
        robot: RobotModel,
    ) -> None:
        """Start at known (n, 3) poses, so that the odometry frames are the map frame; draw the errors.

        ``wheel_angles_rad``: (n, 2) left and right, as ``World.wheel_angles`` gives them.
        """
        self.poses: Floats = np.array(starts, dtype=np.float64)
        """(n, 3) x, y, yaw by dead reckoning, in each robot's odometry frame"""
        self._ticks = np.floor(wheel_angles_rad / TICK_RAD)
        draws = np.array([standard_normals(rng, (3,)) for rng in rngs])  # two wheels, then the track
        scales = 1.0 + settings.radius_error * draws[:, :2]
        separations_m = robot.wheel_separation_m * (1.0 + settings.separation_error * draws[:, 2])
        self._wheels = np.column_stack((scales, separations_m))
        """(n, 3) the scales of the left and right wheel, and metres between them"""
        self._tick_m, self._slip = TICK_RAD * robot.wheel_radius_m, settings.slip_m_per_sqrt_m
        self._noise = NoiseBlocks(rngs, 2)
        self._velocities = np.zeros((len(starts), 2))

    def update(self, rows: Indices, wheel_angles_rad: Floats, elapsed_s: float) -> Floats:
        """(n, 2) mean forward speed (m/s) and yaw rate (rad/s) over ``elapsed_s``, new in ``rows``.

        The poses of ``rows`` move along the heading half-way through the turn (midpoint rule).
        """
        ticks, poses, wheels = np.floor(wheel_angles_rad / TICK_RAD), self.poses[rows], self._wheels[rows]
        ways_m = (ticks - self._ticks)[rows] * self._tick_m * wheels[:, :2]
        travel_m = ways_m + self._slip * np.sqrt(np.abs(ways_m)) * self._noise.draw(rows)
        forward_m = (travel_m[:, 0] + travel_m[:, 1]) / 2.0
        turn = (travel_m[:, 1] - travel_m[:, 0]) / wheels[:, 2]
        self.poses[rows, :2] += forward_m[:, None] * directions(poses[:, 2] + turn / 2.0)
        self.poses[rows, 2] = (poses[:, 2] + turn + math.pi) % (2.0 * math.pi) - math.pi
        self._ticks[rows] = ticks[rows]
        self._velocities[rows] = np.column_stack((forward_m, turn)) / elapsed_s
        return self._velocities
