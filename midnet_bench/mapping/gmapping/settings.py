"""GMapping's parameters under their meanings, and the sets of values to run it with."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class GmappingSettings:
    """The parameters of slam_gmapping that have an effect; as they stand, a TurtleBot3's with 30 particles.

    Values: turtlebot3_slam ``gmapping_params.yaml``, which asks for 100 particles; 30 is slam_gmapping's
    default and what its authors map buildings with. The four ``*sample*`` parameters are left out because the
    released filter never reads them. ``kernelSize`` is 1 and ``lskip`` 0 in every published set, so
    both are built in. The map has no initial size: it holds what was seen and grows.
    """

    particles: int = 30
    max_usable_range_m: float | None = 3.0
    """``maxUrange``: farther returns only clear, up to here; None = the sensor's largest range"""
    sigma_m2: float = 0.05
    """scan-match score: exp(-d^2 / sigma), so 1/e at sqrt(sigma)"""
    linear_step_m: float = 0.05
    """``lstep``: first step of the hill climb along x and y"""
    angular_step_rad: float = 0.05
    """``astep``: first step of the hill climb in yaw"""
    iterations: int = 5
    """halvings of both steps"""
    linear_reliability: float = 0.0
    """per squared metre: a match at distance d from the odometry's pose scores exp(-reliability * d^2) times
    as much. GMapping has it (``m_linearOdometryReliability``) and leaves it off"""
    angular_reliability: float = 0.0
    """per squared radian: the same for a match turned away from the odometry's heading
    (``m_angularOdometryReliability``)"""
    likelihood_sigma_m2: float = 0.075
    """``lsigma``: log-likelihood of a beam, -d^2 / lsigma"""
    miss_m2: float = 0.5
    """d^2 of a beam with nothing near its end (GMapping's nullLikelihood, built in there)"""
    likelihood_gain: float = 3.0
    """``ogain``: how much the weights are flattened"""
    minimum_score: float = 50.0
    """a match counts only above this; the score of a scan lies between 0 and its number of usable beams"""
    noise_srr: float = 0.1
    """metres of translation noise per metre driven"""
    noise_srt: float = 0.2
    """radians of rotation noise per metre driven"""
    noise_str: float = 0.1
    """metres of translation noise per radian turned"""
    noise_stt: float = 0.2
    """radians of rotation noise per radian turned"""
    linear_update_m: float = 1.0
    angular_update_rad: float = 0.2
    temporal_update_s: float | None = 0.5
    """a scan is integrated when more time than this has passed; None = time alone is no reason"""
    resample_threshold: float = 0.5
    """resample when Neff is under this share of the particles"""
    resolution_m: float = 0.05
    """``delta``: side of a cell"""
    occupied_threshold: float = 0.25
    """``occ_thresh``: hits / visits above which a cell is published as occupied"""

    def __post_init__(self) -> None:
        if self.particles < 1:
            raise ValueError(f"particles must be at least 1, not {self.particles}")
        if self.resolution_m <= 0.0:
            raise ValueError(f"resolution_m must be positive, not {self.resolution_m}")


TURTLEBOT3 = GmappingSettings()

TURTLEBOT3_MULTI = GmappingSettings(
    max_usable_range_m=4.0,
    minimum_score=100.0,
    noise_srr=0.01,
    noise_srt=0.02,
    noise_str=0.01,
    noise_stt=0.02,
    linear_update_m=0.2,
)
"""turtlebot3_gazebo ``multi_turtlebot3_slam.launch`` (which asks for 120 particles): trusts its odometry."""

SLAM_GMAPPING = GmappingSettings(
    max_usable_range_m=None, minimum_score=0.0, angular_update_rad=0.5, temporal_update_s=None
)
"""The defaults in slam_gmapping itself, meant for a SICK laser on a Pioneer."""

RECORDED_LOG = replace(SLAM_GMAPPING, linear_update_m=0.3, angular_update_rad=0.3)
"""For logs: what slam_gmapping uses, but hardly a scan of a log that was thinned before is passed over."""

BURGER = replace(
    TURTLEBOT3_MULTI,
    minimum_score=50.0,
    sigma_m2=0.05**2,
    linear_reliability=10.0,
    temporal_update_s=None,
)
"""A Burger with wheel odometry and a LiDAR of 1 cm noise, for which the published values are too loose.

sigma = 0.05 m^2 hardly tells a match from one 5 cm off; here it is the square of a cell. In a corridor the
score alone pulls the robot back to where more of its beams meet what it has seen; the odometry's pull
holds against that. Time alone is no reason to integrate: a standing robot has nothing to add.
"""

BURGER_UKF = replace(
    BURGER,
    linear_step_m=0.0125,
    angular_step_rad=0.003,
    iterations=4,
    linear_reliability=100.0,
    angular_reliability=1e4,
    likelihood_sigma_m2=0.01,
    miss_m2=0.02,
    noise_srt=0.001,
    noise_stt=0.001,
    linear_update_m=0.4,
)
"""A Burger whose odometry frame is the UKF's: its heading is a gyroscope's and drifts by 1e-5 rad/s.

A match is good to about half a milliradian, the heading's change from one scan to the next is known a
hundred times better, and every match adds an error of its own: with ``BURGER`` a labyrinth's map turned by up
to 0.04 rad before a loop closed, where the UKF alone was off by 0.006. So the odometry pulls in both about as
hard as its share in what is known, the finest steps are 0.8 mm and 0.2 mrad, and a scan is matched half as
often. The noise lets particles differ by as much as the gyroscope's drift until a loop closes.

While exploring, many beams end where the map is still empty. GMapping's fixed price for them is that of a
wall 0.7 m away, so luck at the map's edge decides which particle is best; here it is that of a wall 0.14 m
away, just beyond the cells that are searched.

Chosen by drives of one robot through Map 2 with the seeds 1001 and 1002 alone.
"""
