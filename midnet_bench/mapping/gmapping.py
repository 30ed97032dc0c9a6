"""GMapping: a Rao-Blackwellised particle filter in which every particle carries a map of its own."""

import math

import numpy as np

from midnet_bench.elementary import directions, exponentials, standard_normals
from midnet_bench.geometry import LidarGeometry, Pose2D, wrap_angle
from midnet_bench.mapping.grid_slam import ORIGIN, Floats, GridSlam, Indices, ScanRays
from midnet_bench.mapping.mapping_settings import GmappingSettings
from midnet_bench.mapping.particle_map import (
    ParticleMaps,
    ParticleThreads,
    match_particles,
    matching_in_cells,
)


class GMapping(GridSlam):
    """The filter as openslam_gmapping releases it (``gridslamprocessor``), for one planar LiDAR.

    As released, a particle is put *on* the maximum of its scan match; the improved proposal of the papers
    (Grisetti et al. 2007) is not in that code, nor here. The best particle is the one with the largest
    log-likelihood summed over its whole lineage. Departures: the docstrings of ``scan_rays``,
    ``nearest_hit_squared``, ``ParticleMaps`` and ``VisitMap``.

    Args:
        geometry: of the sensor and its mount. The filter moves the sensor's pose, as GMapping does.
        initial: the robot's pose in the map frame when the first scan arrives.
        rng: where motion noise and resampling offsets come from.
        threads: that the particles are shared between; any number gives the same bytes.
    """

    def __init__(
        self,
        geometry: LidarGeometry,
        settings: GmappingSettings,
        initial: Pose2D,
        rng: np.random.Generator,
        threads: int = 1,
    ) -> None:
        usable_m = math.inf if settings.max_usable_range_m is None else settings.max_usable_range_m
        update = (settings.linear_update_m, settings.angular_update_rad, settings.temporal_update_s)
        super().__init__(geometry, usable_m, update, settings.resolution_m, settings.occupied_threshold)
        self.settings = settings
        self._rng = rng
        self._matching = matching_in_cells(settings)
        self._poses = np.tile(np.array(initial.compose(geometry.mount)), (settings.particles, 1))
        self._weights = np.zeros(settings.particles)  # log-likelihoods since the last resampling
        self._weight_sums = np.zeros(settings.particles)  # and since the first scan
        self._threads = ParticleThreads(settings.particles, threads)
        self._maps = ParticleMaps(settings.particles, settings.resolution_m, self._threads)
        self._correction = initial
        self._odometry = ORIGIN
        self._history: list[Floats] = []
        self._ancestors: list[Indices] = []

    @property
    def correction(self) -> Pose2D:
        """The odometry frame in the map frame (map -> odom), as of the last integrated scan."""
        return self._correction._replace(yaw=wrap_angle(self._correction.yaw))

    @property
    def best_pose(self) -> Pose2D:
        """The robot's base in the map frame: the last odometry pose, corrected."""
        pose = self._correction.compose(self._odometry)
        return pose._replace(yaw=wrap_angle(pose.yaw))

    @property
    def _best(self) -> int:
        return int(np.argmax(self._weight_sums))

    def _move(self, odometry_pose: Pose2D) -> Pose2D:
        step, mount = ORIGIN, self.geometry.mount
        if self._scans:
            step = odometry_pose.compose(mount).relative_to(self._odometry.compose(mount))
            self._poses = move_particles(self._poses, step, self.settings, self._rng)
        self._odometry = odometry_pose
        return step

    def _integrate(self, rays: ScanRays) -> None:
        score, ancestors = math.nan, np.arange(self.settings.particles)
        if self._scans:
            score = self._match(rays)
            ancestors = self._resample(ancestors)
        self.scores.append(score)
        self._maps.register(self._poses, *rays)
        self._history.append(self._poses)
        self._ancestors.append(ancestors)
        self._correction = self._base_pose(self._poses[self._best]).compose(self._odometry.inverse())

    def _match(self, rays: ScanRays) -> float:
        """Put every particle on its match and weigh it by that; the best one's score per beam that hit."""
        maps, poses = self._maps, self._maps.to_cells(self._poses)
        beams = rays.ends_m[: rays.hits] / self.settings.resolution_m
        parts = self._threads.over_particles(
            lambda part: match_particles(maps.means, maps.tables[part], beams, poses[part], self._matching)
        )
        matched, likelihoods, scores = (np.concatenate(both) for both in zip(*parts, strict=True))
        self._poses = self._maps.to_metres(matched)
        self._weights = self._weights + likelihoods
        self._weight_sums = self._weight_sums + likelihoods
        return float(scores[self._best]) / rays.hits if rays.hits else math.nan

    def _resample(self, ancestors: Indices) -> Indices:
        """The ancestors of the particles after resampling, or as they were when none was needed."""
        weights = normalized_weights(self._weights, self.settings.likelihood_gain)
        if effective_particles(weights) >= self.settings.resample_threshold * len(weights):
            return ancestors
        ancestors = systematic_resample(weights, self._rng.random())
        self._poses = self._poses[ancestors]
        self._weight_sums = self._weight_sums[ancestors]
        self._weights = np.zeros(len(weights))
        self._maps.resample(ancestors)
        return ancestors

    def _sensor_poses(self) -> Floats:
        """(N, 3) of the best particle's ancestor at each integrated scan."""
        poses = np.empty((len(self._history), 3))
        particle = self._best
        for k in reversed(range(len(poses))):
            poses[k] = self._history[k][particle]
            particle = int(self._ancestors[k][particle])
        return poses


def noise_deviations(increment: Pose2D, settings: GmappingSettings) -> Floats:
    """(3,) standard deviations of the noise on an increment's x, y (metres) and yaw (radians).

    Proportional to the motion, so a standing robot's particles stay where they are. ``str`` weighs
    rotation into translation and ``srt`` translation into rotation, as GMapping's code has it
    (the comments in its ini files say the opposite).
    """
    dx, dy, turn = abs(increment.x), abs(increment.y), abs(increment.yaw)
    s = settings
    along_x = s.noise_srr * dx + s.noise_str * turn + 0.3 * s.noise_srr * dy
    along_y = s.noise_srr * dy + s.noise_str * turn + 0.3 * s.noise_srr * dx
    return np.array([along_x, along_y, s.noise_stt * turn + s.noise_srt * math.hypot(dx, dy)])


def move_particles(
    poses: Floats, increment: Pose2D, settings: GmappingSettings, rng: np.random.Generator
) -> Floats:
    """(N, 3) poses, map frame, moved by the odometry's increment with Gaussian noise for each particle.

    Three standard normal draws per particle are taken, also for a standing robot.
    """
    steps = np.array(increment) + standard_normals(rng, poses.shape) * noise_deviations(increment, settings)
    cos, sin = directions(poses[:, 2]).T
    yaw = poses[:, 2] + steps[:, 2]
    return np.column_stack(
        [
            poses[:, 0] + cos * steps[:, 0] - sin * steps[:, 1],
            poses[:, 1] + sin * steps[:, 0] + cos * steps[:, 1],
            (yaw + np.pi) % (2.0 * np.pi) - np.pi,
        ]
    )


def normalized_weights(log_weights: Floats, gain: float) -> Floats:
    """(N,) weights that sum to 1 from summed log-likelihoods: proportional to exp(l / (gain * N)).

    The division by N is GMapping's (``gridslamprocessor.hxx``, normalize).
    """
    flattened = exponentials((log_weights - log_weights.max()) / (gain * len(log_weights)))
    return flattened / math.fsum(flattened.tolist())


def effective_particles(weights: Floats) -> float:
    """Neff = 1 / sum of w^2: N for equal weights, 1 when one particle has all."""
    return 1.0 / math.fsum((weights * weights).tolist())


def systematic_resample(weights: Floats, offset: float) -> Indices:
    """(N,) indices of the particles that live on, ascending: one at each of N equally spaced places.

    ``weights`` (N,) sum to 1; ``offset`` in [0, 1) says where the first place lies in its interval of 1 / N.
    """
    places = (np.arange(len(weights)) + offset) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), places, side="right"), len(weights) - 1)
