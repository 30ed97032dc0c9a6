"""GMapping's parameters under their meanings, and the sets of values to run it with."""

from dataclasses import dataclass
from typing import ClassVar

from midnet_bench.settings import Settings, option


@dataclass(frozen=True)
class GmappingSettings(Settings):
    """The parameters of slam_gmapping that have an effect; as they stand, a TurtleBot3's with 30 particles.

    Values: turtlebot3_slam ``gmapping_params.yaml``, which asks for 100 particles; 30 is slam_gmapping's
    default and what its authors map buildings with. The four ``*sample*`` parameters are left out because the
    released filter never reads them. ``kernelSize`` is 1 and ``lskip`` 0 in every published set, so
    both are built in. The map has no initial size: it holds what was seen and grows.
    """

    concern: ClassVar[str] = "gmapping"

    particles: int = option(
        30, "Particles of each robot's GMapping.", ge=1, le=1000, source="package: slam_gmapping, particles"
    )
    max_usable_range_m: float | None = option(
        3.0,
        "Farther returns only clear, up to this distance (maxUrange); null: the sensor's largest range.",
        gt=0,
        le=100,
        source="package: turtlebot3_slam, gmapping_params.yaml, maxUrange",
    )
    sigma_m2: float = option(
        0.05,
        "Width of the scan-match score exp(-d^2 / sigma), m^2: 1/e at its square root.",
        gt=0,
        le=100,
        source="package: slam_gmapping, sigma",
    )
    linear_step_m: float = option(
        0.05,
        "First step of the hill climb along x and y (lstep).",
        gt=0,
        le=1,
        source="package: slam_gmapping, lstep",
    )
    angular_step_rad: float = option(
        0.05,
        "First step of the hill climb in heading (astep).",
        gt=0,
        le=1,
        source="package: slam_gmapping, astep",
    )
    iterations: int = option(
        5,
        "How often both steps of the hill climb are halved.",
        ge=0,
        le=20,
        source="package: slam_gmapping, iterations",
    )
    linear_reliability: float = option(
        0.0,
        "A match at distance d from the odometry's pose scores exp(-reliability * d^2) times as much, 1/m^2 "
        "(m_linearOdometryReliability, which GMapping leaves off).",
        ge=0,
        source="package: openslam_gmapping, m_linearOdometryReliability",
    )
    angular_reliability: float = option(
        0.0,
        "The same for a match turned away from the odometry's heading, 1/rad^2 "
        "(m_angularOdometryReliability).",
        ge=0,
        source="package: openslam_gmapping, m_angularOdometryReliability",
    )
    likelihood_sigma_m2: float = option(
        0.075,
        "Width of a beam's log-likelihood -d^2 / sigma, m^2 (lsigma).",
        gt=0,
        le=100,
        source="package: slam_gmapping, lsigma",
    )
    miss_m2: float = option(
        0.5,
        "d^2 of a beam with nothing near its end (nullLikelihood, built in in GMapping).",
        ge=0,
        le=100,
        source="package: openslam_gmapping, nullLikelihood",
    )
    likelihood_gain: float = option(
        3.0,
        "How much the particles' weights are flattened (ogain).",
        gt=0,
        le=1000,
        source="package: slam_gmapping, ogain",
    )
    minimum_score: float = option(
        50.0,
        "A match counts only above this score, which lies between 0 and the number of usable beams.",
        ge=0,
        le=10_000,
        source="package: turtlebot3_slam, gmapping_params.yaml, minimumScore",
    )
    noise_srr: float = option(
        0.1,
        "Metres of translation noise per metre driven.",
        ge=0,
        le=10,
        source="package: slam_gmapping, srr",
    )
    noise_srt: float = option(
        0.2, "Radians of rotation noise per metre driven.", ge=0, le=10, source="package: slam_gmapping, srt"
    )
    noise_str: float = option(
        0.1,
        "Metres of translation noise per radian turned.",
        ge=0,
        le=10,
        source="package: slam_gmapping, str",
    )
    noise_stt: float = option(
        0.2, "Radians of rotation noise per radian turned.", ge=0, le=10, source="package: slam_gmapping, stt"
    )
    linear_update_m: float = option(
        1.0,
        "A scan is integrated after a drive of this length.",
        ge=0,
        le=100,
        source="package: slam_gmapping, linearUpdate",
    )
    angular_update_rad: float = option(
        0.2,
        "A scan is integrated after a turn by this angle.",
        ge=0,
        le=10,
        source="package: turtlebot3_slam, gmapping_params.yaml, angularUpdate",
    )
    temporal_update_s: float | None = option(
        0.5,
        "A scan is integrated after this time; null: time alone is no reason.",
        ge=0,
        le=3600,
        source="package: turtlebot3_slam, gmapping_params.yaml, temporalUpdate",
    )
    resample_threshold: float = option(
        0.5,
        "Resample when fewer than this share of the particles is effective.",
        ge=0,
        le=1,
        source="package: slam_gmapping, resampleThreshold",
    )
    resolution_m: float = option(
        0.05, "Side of a cell (delta).", gt=0, le=1, source="package: slam_gmapping, delta"
    )
    occupied_threshold: float = option(
        0.25,
        "Cells hit in more than this share of the visits are published as occupied (occ_thresh).",
        ge=0,
        le=1,
        source="package: slam_gmapping, occ_thresh",
    )


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
