"""What can be set of GMapping, frontier exploration and the merging of maps."""

from dataclasses import dataclass

from midnet_bench.settings import Settings, fixed, option


@dataclass(frozen=True)
class GmappingSettings(Settings):
    """The parameters of slam_gmapping that have an effect; as they stand, a TurtleBot3's with 30 particles.

    Values: turtlebot3_slam ``gmapping_params.yaml``, which asks for 100 particles; 30 is slam_gmapping's
    default and what its authors map buildings with. The four ``*sample*`` parameters are left out because the
    released filter never reads them. ``kernelSize`` is 1 and ``lskip`` 0 in every published set, so
    both are built in. The map has no initial size: it holds what was seen and grows.
    """

    particles: int = option(
        30, "Particles of each robot's GMapping.", ge=1, le=1000, source="package: slam_gmapping, particles"
    )
    max_usable_range_m: float | None = fixed(3.0, "package: turtlebot3_slam, gmapping_params.yaml, maxUrange")
    sigma_m2: float = fixed(0.05, "package: slam_gmapping, sigma")
    linear_step_m: float = fixed(0.05, "package: slam_gmapping, lstep")
    angular_step_rad: float = fixed(0.05, "package: slam_gmapping, astep")
    iterations: int = fixed(5, "package: slam_gmapping, iterations")
    linear_reliability: float = fixed(0.0, "package: openslam_gmapping, m_linearOdometryReliability")
    angular_reliability: float = fixed(0.0, "package: openslam_gmapping, m_angularOdometryReliability")
    likelihood_sigma_m2: float = fixed(0.075, "package: slam_gmapping, lsigma")
    miss_m2: float = fixed(0.5, "package: openslam_gmapping, nullLikelihood")
    likelihood_gain: float = fixed(3.0, "package: slam_gmapping, ogain")
    minimum_score: float = fixed(50.0, "package: turtlebot3_slam, gmapping_params.yaml, minimumScore")
    noise_srr: float = fixed(0.1, "package: slam_gmapping, srr")
    noise_srt: float = fixed(0.2, "package: slam_gmapping, srt")
    noise_str: float = fixed(0.1, "package: slam_gmapping, str")
    noise_stt: float = fixed(0.2, "package: slam_gmapping, stt")
    linear_update_m: float = fixed(1.0, "package: slam_gmapping, linearUpdate")
    angular_update_rad: float = fixed(0.2, "package: turtlebot3_slam, gmapping_params.yaml, angularUpdate")
    temporal_update_s: float | None = fixed(
        0.5, "package: turtlebot3_slam, gmapping_params.yaml, temporalUpdate"
    )
    resample_threshold: float = fixed(0.5, "package: slam_gmapping, resampleThreshold")
    resolution_m: float = fixed(0.05, "package: slam_gmapping, delta")
    occupied_threshold: float = fixed(0.25, "package: slam_gmapping, occ_thresh")


RECORDED_LOG = GmappingSettings(
    max_usable_range_m=None,
    minimum_score=0.0,
    linear_update_m=0.3,
    angular_update_rad=0.3,
    temporal_update_s=None,
)
"""slam_gmapping's own defaults, but hardly a scan of a log that was thinned before is passed over."""

BURGER_UKF = GmappingSettings(
    max_usable_range_m=4.0,
    sigma_m2=0.05 * 0.05,
    linear_step_m=0.0125,
    angular_step_rad=0.003,
    iterations=4,
    linear_reliability=100.0,
    angular_reliability=1e4,
    likelihood_sigma_m2=0.01,
    miss_m2=0.02,
    noise_srr=0.01,
    noise_srt=0.001,
    noise_str=0.01,
    noise_stt=0.001,
    linear_update_m=0.4,
    temporal_update_s=None,
)
"""A Burger whose odometry frame is the UKF's: its heading is a gyroscope's and drifts by 1e-5 rad/s.

turtlebot3_gazebo's ``multi_turtlebot3_slam.launch`` trusts the odometry, but matches too loosely for a LiDAR
of 1 cm noise: sigma = 0.05 m^2 hardly tells a match from one 5 cm off; here it is the square of a cell. In
a corridor the score alone pulls the robot back to where more of its beams meet what it has seen; the
odometry's pull holds against that. Time alone is no reason to integrate: a standing robot has nothing to add.

A match is good to about half a milliradian, the heading's change from one scan to the next is known a
hundred times better, and every match adds an error of its own. So the odometry pulls in both about as
hard as its share in what is known, the finest steps are 0.8 mm and 0.2 mrad, and a scan is matched only each
0.4 m. The noise lets particles differ by as much as the gyroscope's drift until a loop closes.

While exploring, many beams end where the map is still empty. GMapping's fixed price for them is that of a
wall 0.7 m away, so luck at the map's edge decides which particle is best; here it is that of a wall 0.14 m
away, just beyond the cells that are searched.

Chosen by drives of one robot through Map 2 with the seeds 1001 and 1002 alone.
"""

_MULTI = "package: turtlebot3_gazebo, multi_turtlebot3_slam.launch"
_DRIVES = "ours: by drives through Map 2, seeds 1001 and 1002"
BURGER_UKF_SOURCES = {
    "max_usable_range_m": f"{_MULTI}, maxUrange",
    "sigma_m2": "ours: the square of a cell; slam_gmapping's 0.05 m^2 hardly tells a match from one 5 cm off",
    "linear_step_m": _DRIVES,
    "angular_step_rad": _DRIVES,
    "iterations": _DRIVES,
    "linear_reliability": _DRIVES,
    "angular_reliability": _DRIVES,
    "likelihood_sigma_m2": _DRIVES,
    "miss_m2": _DRIVES,
    "noise_srr": f"{_MULTI}, srr",
    "noise_srt": _DRIVES,
    "noise_str": f"{_MULTI}, str",
    "noise_stt": _DRIVES,
    "linear_update_m": _DRIVES,
    "temporal_update_s": "package: slam_gmapping, temporalUpdate",
}
"""Sources of the values of ``BURGER_UKF`` that are not those of :class:`GmappingSettings`."""


@dataclass(frozen=True)
class FrontierSettings(Settings):
    """The parameters of explore_lite, and those of the repairs made here."""

    potential_scale: float = fixed(3.0, "package: explore_lite, explore_costmap.launch, potential_scale")
    gain_scale: float = fixed(1.0, "package: explore_lite, gain_scale")
    min_frontier_size_m: float = fixed(0.5, "package: explore_lite, min_frontier_size")
    progress_timeout_s: float = fixed(30.0, "package: explore_lite, progress_timeout")
    blacklist_half_width_m: float = fixed(0.5, "ours: explore_lite has 5 cells, 0.25 m")
    second_chances: int = fixed(1, "ours: explore_lite never empties its list")
    traversable_below: int = fixed(99, "ours: explore_lite's search follows falling costs alone")
    taken_radius_m: float = fixed(2.0, "ours: explore_lite knows no other robots")
    min_gap_m: float = fixed(0.1, "ours: two cells; a gap of one lies within a cell of walls on both sides")
    view_m: float = fixed(1.0, "ours: beams are 1.7 cm apart there, a third of a cell")
    look_radius_m: float = fixed(0.5, "ours: as far as a blacklisted goal counts")


@dataclass(frozen=True)
class MergeSettings(Settings):
    """When two maps are merged and when they are refused."""

    min_confidence: float = fixed(
        0.7, "ours: off unless merge=features; multirobot_map_merge's 1.0 leaves out good pairs"
    )
    max_scale_error: float = fixed(0.02, "ours: off unless merge=features")
    min_agreement: float = fixed(0.9, "ours: off unless merge=features")
    min_overlap: float = fixed(0.25, "ours: off unless merge=features")
    max_rival: float = fixed(0.3, "ours: off unless merge=features")
