"""The parameters of slam_gmapping, as three robots use them."""

from dataclasses import dataclass

from midnet_bench.settings import Settings, option


@dataclass(frozen=True)
class GmappingSettings(Settings):
    """The parameters of slam_gmapping that have an effect; as they stand, a TurtleBot3's with 30 particles.

    Values are slam_gmapping's defaults but for those of turtlebot3_slam's ``gmapping_params.yaml`` (T), which
    asks for 100 particles, and of openslam_gmapping's code (C). The four ``*sample*`` parameters are left out
    because the released filter never reads them. ``kernelSize`` is 1 and ``lskip`` 0 in every published set,
    so both are built in. The map has no initial size: it holds what was seen and grows.
    """

    particles: int = option(
        30, "Particles of each robot's GMapping.", ge=1, le=1000, source="package: slam_gmapping, particles"
    )
    max_usable_range_m: float | None = 3.0  # maxUrange (T); None: up to the sensor's range
    sigma_m2: float = 0.05  # sigma
    linear_step_m: float = 0.05  # lstep
    angular_step_rad: float = 0.05  # astep
    iterations: int = 5  # iterations
    linear_reliability: float = 0.0  # m_linearOdometryReliability (C)
    angular_reliability: float = 0.0  # m_angularOdometryReliability (C)
    likelihood_sigma_m2: float = 0.075  # lsigma
    miss_m2: float = 0.5  # nullLikelihood (C)
    likelihood_gain: float = 3.0  # ogain
    minimum_score: float = 50.0  # minimumScore (T)
    noise_srr: float = 0.1  # srr
    noise_srt: float = 0.2  # srt
    noise_str: float = 0.1  # str
    noise_stt: float = 0.2  # stt
    linear_update_m: float = 1.0  # linearUpdate
    angular_update_rad: float = 0.2  # angularUpdate (T)
    temporal_update_s: float | None = 0.5  # temporalUpdate (T); None: never
    resample_threshold: float = 0.5  # resampleThreshold
    resolution_m: float = 0.05  # delta
    occupied_threshold: float = 0.25  # occ_thresh


RECORDED_LOG = GmappingSettings(
    max_usable_range_m=None,
    minimum_score=0.0,
    linear_update_m=0.3,
    angular_update_rad=0.3,
    temporal_update_s=None,
)
"""slam_gmapping's own defaults, but hardly a scan of a log that was thinned before is passed over."""

BURGER_UKF = GmappingSettings(
    max_usable_range_m=4.0,  # maxUrange of turtlebot3_gazebo's multi_turtlebot3_slam.launch
    sigma_m2=0.05 * 0.05,
    linear_step_m=0.0125,
    angular_step_rad=0.003,
    iterations=4,
    linear_reliability=100.0,
    angular_reliability=1e4,
    likelihood_sigma_m2=0.01,
    miss_m2=0.02,
    noise_srr=0.01,  # of that file too, as noise_str
    noise_srt=0.001,
    noise_str=0.01,
    noise_stt=0.001,
    linear_update_m=0.4,
    temporal_update_s=None,
)
"""A Burger whose odometry frame is the UKF's: its heading is a gyroscope's and drifts by 1e-5 rad/s.

turtlebot3_gazebo's ``multi_turtlebot3_slam.launch`` trusts the odometry, but its sigma of 0.05 m^2 hardly
tells a match from one 5 cm off; here it is the square of a cell. In a corridor the score alone pulls the
robot back to where more is mapped, and every match adds about half a milliradian, while the heading's change
between scans is known a hundred times better. So the odometry pulls about as hard as its share in what is
known, the finest steps are 0.8 mm and 0.2 mrad, and a scan is matched only each 0.4 m. The noise lets
particles differ by as much as the gyroscope's drift until a loop closes. A beam into the unknown costs as
much as a wall 0.14 m away, just beyond the cells that are searched; at GMapping's 0.7 m luck at the map's
edge decides which particle is best.

Chosen by drives of one robot through Map 2 with the seeds 1001 and 1002 alone.
"""
