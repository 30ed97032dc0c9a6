"""What can be set of graph SLAM."""

from dataclasses import dataclass


@dataclass(frozen=True)
class GraphSlamSettings:
    """The parameters; as they stand, for a laser of 180 beams and more in a building.

    Chosen on one log and on drawn buildings: docs/studies/slips.md.
    """

    linear_update_m: float = 0.3
    """a scan becomes a node after a drive of this length,"""
    angular_update_rad: float = 0.3
    """or after a turn by this angle, radians"""
    farthest_m: float = 25.0
    """farther returns are drawn, but not matched"""
    thin_m: float = 0.1
    """one return in a square of this side is matched: near walls count no more than far ones"""
    running_scans: int = 20
    """a new scan is matched against so many before it"""
    collapsed: float = 0.75
    """a match below this share of the median of the last 50 scores is searched for again in a wide window,"""
    gain: float = 0.1
    """whose match is taken if its score is better by this much"""
    loop_radius_m: float = 4.0
    """a loop may close with scans from so near"""
    loop_scans: int = 10
    """and is matched against so many before and after the nearest of them"""
    loop_score: float = 0.55
    """a loop closes with a better match than this, which lies between 0 and 1"""
    lately_scans: int = 8
    """after a long way without a loop, so many scans are matched at once, as one"""
    long_way_m: float = 10.0
    """what a long way is"""
    surprise_m: float = 0.3
    """a closure that moves the robot by more than this"""
    surprise_rad: float = 0.1
    """or turns it by more than this, radians, is believed only"""
    agreeing: int = 3
    """when so many within eight nodes agree, to as much as a surprise"""
    hit_deviation_m: float = 0.1
    """how far a hit may be off its wall: what an edge of the graph weighs"""
    odometry_deviation: float = 0.2
    """how far the odometry may be off between two nodes, metres and radians"""
    resolution_m: float = 0.05
    """side of a cell of the map"""
    occupied_threshold: float = 0.25
    """cells hit in more than this share of the visits are occupied in the map"""
