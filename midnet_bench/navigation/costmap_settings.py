"""The parameters of a costmap, with costmap_2d's names where it has them."""

import math
from dataclasses import dataclass

from midnet_bench.errors import InputError
from midnet_bench.navigation import footprint as outlines
from midnet_bench.navigation.footprint import Footprint


@dataclass(frozen=True)
class CostmapSettings:
    """One costmap. The defaults are those of costmap_2d for a robot of radius 0.105 m, in a 5 x 5 m window.

    MIDNet's local costmaps depart from them in two values, by calibration: a 4 m window (item 6) and
    ``inf_is_valid`` (item 8). ``burger_local`` and ``burger_global`` give what a TurtleBot3 navigates with.
    """

    resolution: float = 0.05
    """metres per cell"""
    size_m: float = 5.0
    """side of a rolling window; a costmap over a static map has the map's size"""
    centered: bool = True
    """a rolling window whose middle cell is always the robot's (Eqs. 2 to 4), not costmap_2d's lazy one"""
    obstacle_range_m: float = 2.5
    """only hits nearer than this are marked"""
    raytrace_range_m: float = 3.0
    """beams clear up to here"""
    inflation_radius_m: float = 0.55
    cost_scaling_factor: float = 10.0
    """decay of the inflated cost, per metre"""
    inscribed_radius_m: float = 0.105
    footprint: Footprint = outlines.BURGER_PADDED
    """the polygon that is free because the robot stands there"""
    footprint_clearing: bool = True
    track_unknown: bool = False
    """cells that nobody has seen are 255, not free"""
    inf_is_valid: bool = False
    """a beam without a return clears its way; in TurtleBot3's files it does not, and ghosts remain"""
    memory_s: float = math.inf
    """how long a mark outlives the scan that last hit it: ``inf`` is costmap_2d (until a beam passes),
    0 keeps the newest scan only, anything between lets marks decay (item 8)"""

    def __post_init__(self) -> None:
        positive = ("resolution", "size_m", "obstacle_range_m", "raytrace_range_m", "cost_scaling_factor")
        for name in positive:
            if not getattr(self, name) > 0.0:
                raise InputError(f"costmap: {name} must be greater than 0 (got {getattr(self, name)})")
        for name in ("inflation_radius_m", "inscribed_radius_m", "memory_s"):
            if not getattr(self, name) >= 0.0:
                raise InputError(f"costmap: {name} must not be negative (got {getattr(self, name)})")
        if self.inflation_radius_m > 100 * self.resolution:
            raise InputError(
                f"costmap: inflation_radius_m {self.inflation_radius_m} spans more than 100 cells of "
                f"{self.resolution} m; use a coarser resolution or a smaller radius"
            )

    @property
    def size_cells(self) -> int:
        """Cells along one side of a rolling window."""
        return max(1, round(self.size_m / self.resolution))


_MARGIN_M = 0.03
"""around the Burger's footprint. The vendor has 0.01, but where other Burgers are, of which a LiDAR sees the
11 cm of their own LiDAR and not the 18 cm below it, 0.03 keeps robots out of each other's way"""


def burger_local() -> CostmapSettings:
    """The local costmap of turtlebot3_navigation: 3 x 3 m that roll with the robot, no static map.

    Two values depart from the vendor's: the footprint's padding (0.03 for 0.01 m), and ``inf_is_valid``,
    which turtlebot3's frontier_exploration.yaml alone sets: without it, a robot that passed in front of open
    space leaves marks that nothing clears, and the way stays closed.
    """
    return _burger(size_m=3.0, centered=False)


def burger_global(resolution: float = 0.05) -> CostmapSettings:
    """The global costmap of turtlebot3_navigation: the static map's size, with an obstacle layer.

    Departs from the vendor's values as ``burger_local`` does.
    """
    return _burger(resolution=resolution)


def _burger(resolution: float = 0.05, size_m: float = 3.0, centered: bool = False) -> CostmapSettings:
    footprint = outlines.padded(outlines.BURGER, _MARGIN_M)
    return CostmapSettings(
        resolution=resolution,
        size_m=size_m,
        centered=centered,
        obstacle_range_m=3.0,
        raytrace_range_m=3.5,
        inflation_radius_m=1.0,
        cost_scaling_factor=3.0,
        inscribed_radius_m=outlines.radii(footprint)[0],
        footprint=footprint,
        inf_is_valid=True,
    )
