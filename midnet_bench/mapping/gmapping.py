"""GMapping: a Rao-Blackwellised particle filter in which every particle carries a map of its own.

The filter, then what it is made of: its motion model, the rays of a scan, weights and resampling.
"""

import math

import numpy as np
import numpy.typing as npt

from midnet_bench.elementary import directions, exponentials
from midnet_bench.geometry import LidarGeometry, Pose2D, wrap_angle
from midnet_bench.mapping.grid_slam import GridSlam, ScanRays, scan_rays
from midnet_bench.mapping.mapping_settings import GmappingSettings
from midnet_bench.mapping.particle_map import (
    ParticleMaps,
    ParticleThreads,
    match_particles,
    matching_in_cells,
)
from midnet_bench.rng import standard_normals


class GMapping(GridSlam):
    """The filter as openslam_gmapping releases it (``gridslamprocessor``), for one planar LiDAR.

    As released, a particle is put *on* the maximum of its scan match; the improved proposal of the papers
    (Grisetti et al. 2007) is not in that code, nor here. The best particle is the one with the largest
    log-likelihood summed over its whole lineage. Departures: the docstrings of ``scan_rays``,
    ``nearest_hit_squared``, ``ParticleMaps`` and ``VisitMap``.

    Args:
        geometry: of the sensor and its mount. The filter moves the sensor's pose, as GMapping does.
        settings: the parameters.
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
        update = (settings.linear_update_m, settings.angular_update_rad, settings.temporal_update_s)
        super().__init__(geometry, update, settings.resolution_m, settings.occupied_threshold)
        self.settings = settings
        self._rng = rng
        usable_m = settings.max_usable_range_m
        self._usable_m = math.inf if usable_m is None else usable_m
        self._matching = matching_in_cells(settings)
        self._poses = np.tile(np.array(initial.compose(geometry.mount)), (settings.particles, 1))
        self._weights = np.zeros(settings.particles)
        self._weight_sums = np.zeros(settings.particles)
        self._threads = ParticleThreads(settings.particles, threads)
        self._maps = ParticleMaps(settings.particles, settings.resolution_m, self._threads)
        self._correction = initial
        self._odometry = Pose2D(0.0, 0.0, 0.0)
        self._history: list[npt.NDArray[np.float64]] = []
        self._ancestors: list[npt.NDArray[np.int64]] = []

    def process(self, odometry_pose: Pose2D, ranges_m: npt.NDArray[np.float64], time_s: float) -> bool:
        """As :meth:`GridSlam.process`."""
        if ranges_m.shape != (self.geometry.beams,):
            raise ValueError(f"a scan of shape {ranges_m.shape} from a sensor of {self.geometry.beams} beams")
        first = not self._stamps_s
        step = Pose2D(0.0, 0.0, 0.0)
        if not first:
            mount = self.geometry.mount
            step = odometry_pose.compose(mount).relative_to(self._odometry.compose(mount))
            self._poses = move_particles(self._poses, step, self.settings, self._rng)
        self._odometry = odometry_pose
        if not self._is_due(step, time_s):
            return False

        rays = scan_rays(self.geometry, ranges_m, self._usable_m)
        ancestors = np.arange(self.settings.particles)
        score = math.nan
        if not first:
            score = self._match(rays)
            ancestors = self._resample(ancestors)
        self._maps.register(self._poses, *rays)
        self._integrate(rays, time_s, score)
        self._history.append(self._poses)
        self._ancestors.append(ancestors)
        self._correction = self._base_pose(self._poses[self._best]).compose(odometry_pose.inverse())
        return True

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

    def _match(self, rays: ScanRays) -> float:
        """Put every particle on its scan match and add the log-likelihood to its weights.

        The best particle's score per beam that hit comes back, as :attr:`scores` has it.
        """
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

    def _resample(self, ancestors: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
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

    def _sensor_poses(self) -> npt.NDArray[np.float64]:
        """(N, 3) of the best particle's ancestor at each integrated scan."""
        poses = np.empty((len(self._history), 3))
        particle = self._best
        for k in reversed(range(len(poses))):
            poses[k] = self._history[k][particle]
            particle = int(self._ancestors[k][particle])
        return poses


def noise_deviations(increment: Pose2D, settings: GmappingSettings) -> npt.NDArray[np.float64]:
    """(3,) standard deviations of the noise on an increment's x, y (metres) and yaw (radians).

    Proportional to the motion, so a standing robot's particles stay where they are. ``str`` weighs
    rotation into translation and ``srt`` translation into rotation, as GMapping's code has it
    (the comments in its ini files say the opposite).
    """
    dx, dy, turn = abs(increment.x), abs(increment.y), abs(increment.yaw)
    s = settings
    return np.array(
        [
            s.noise_srr * dx + s.noise_str * turn + 0.3 * s.noise_srr * dy,
            s.noise_srr * dy + s.noise_str * turn + 0.3 * s.noise_srr * dx,
            s.noise_stt * turn + s.noise_srt * math.hypot(dx, dy),
        ]
    )


def move_particles(
    poses: npt.NDArray[np.float64], increment: Pose2D, settings: GmappingSettings, rng: np.random.Generator
) -> npt.NDArray[np.float64]:
    """(N, 3) poses after the increment with Gaussian noise of its own for each particle.

    Args:
        poses: (N, 3) float64, x, y (metres) and yaw (radians) in the map frame.
        increment: the odometry's motion in the frame of its previous pose.
        settings: the four noise shares.
        rng: three standard normal draws per particle are taken, also for a standing robot.
    """
    noise = standard_normals(rng, poses.shape) * noise_deviations(increment, settings)
    steps = np.array(increment) + noise
    cos, sin = directions(poses[:, 2]).T
    yaw = poses[:, 2] + steps[:, 2]
    return np.column_stack(
        [
            poses[:, 0] + cos * steps[:, 0] - sin * steps[:, 1],
            poses[:, 1] + sin * steps[:, 0] + cos * steps[:, 1],
            (yaw + np.pi) % (2.0 * np.pi) - np.pi,
        ]
    )


def normalized_weights(log_weights: npt.NDArray[np.float64], gain: float) -> npt.NDArray[np.float64]:
    """(N,) weights that sum to 1 from summed log-likelihoods: proportional to exp(l / (gain * N)).

    The division by N is GMapping's (``gridslamprocessor.hxx``, normalize).
    """
    flattened = exponentials((log_weights - log_weights.max()) / (gain * len(log_weights)))
    return flattened / math.fsum(flattened.tolist())


def effective_particles(weights: npt.NDArray[np.float64]) -> float:
    """Neff = 1 / sum of w^2: N for equal weights, 1 when one particle has all."""
    return 1.0 / math.fsum((weights * weights).tolist())


def systematic_resample(weights: npt.NDArray[np.float64], offset: float) -> npt.NDArray[np.int64]:
    """(N,) indices of the particles that live on, ascending: one at each of N equally spaced places.

    Args:
        weights: (N,) that sum to 1.
        offset: in [0, 1), where the first place lies in its interval of 1 / N.
    """
    places = (np.arange(len(weights)) + offset) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), places, side="right"), len(weights) - 1)
