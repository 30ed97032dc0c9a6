"""What section IV leaves open. It stands apart from what works by it, whose imports take longer."""

from dataclasses import dataclass
from typing import Literal

from midnet_bench.settings import Settings, inner, option

Align = Literal["floor", "origin"]
AllyRemove = Literal["first", "best", "all"]
Unknown = Literal["free", "occupied"]


@dataclass(frozen=True)
class PriorMapSettings(Settings):
    """How the prior map's costmap becomes the grid that is subtracted."""

    thresh: int = option(
        30,
        "Cost from which a cell of the prior map's costmap counts as occupied, thresh of Eq. 1; 30 is"
        " 0.225 m around a wall, a higher one reaches less far.",
        ge=1,
        le=100,
        key="thresh_global",
        source="ours: II.A and IV.A give no number; 0.12 m farther than thresh_local",
    )
    unknown: Unknown = option(
        "free",
        "What counts as lying in cells of the prior map that nobody has explored: nothing (free) or a"
        " wall (occupied).",
        key="unknown_in_prior",
        source="paper: IV.A, white is a free or an unknown cell",
    )


@dataclass(frozen=True)
class MIDNetSettings(Settings):
    """What section IV leaves open; the defaults are our readings."""

    thresh_local: int = option(
        99,
        "Cost from which a cell of a local costmap counts as occupied, thresh of Eq. 1; 99 is 0.105 m"
        " around a return, a lower one reaches farther.",
        ge=1,
        le=100,
        source="ours: IV.A gives no number; 99 is a Burger's robot_radius around a return",
    )
    unknown: Unknown = option(
        "free",
        "What Eq. 1 makes of a cell of a local costmap that no beam has met yet.",
        key="unknown_in_local",
        source="paper: IV.A, white is a free or an unknown cell",
    )
    align: Align = option(
        "floor",
        "Which part of the prior map a local costmap is compared with: by the robot's pose, rounded "
        "down to cells (floor, Eqs. 2 to 4), or by the costmap's own origin (origin).",
        source="paper: IV.B.1, Eqs. 2 to 4, rounded down",
    )
    min_area_cells: int = option(
        1, "Blobs of fewer cells are dropped.", ge=1, le=1000, source="paper: IV.B.4, each contour has a box"
    )
    min_returns: int = option(
        0,
        "A box that holds fewer returns of its robot's last scan is dropped; 0 keeps all, boxes of "
        "marks without any return too.",
        ge=0,
        le=1000,
        source="paper: IV.B.4, each contour has a box",
    )
    deflate_boxes_m: float = inner(0.0, ge=0)
    """taken off each side of a box as soon as it is found; changes every later IoU (item 25)"""
    return_area_m2: float = inner(0.0, ge=0)
    """from which on a return counts as one for ``min_returns`` (``WallEvidence``); 0: each does"""
    ally_diameter_m: float = option(
        0.225,
        "Side of the square that a guard is taken to fill, di of Algorithm 2: the diameter of the "
        "circle about the robot's length and width, of a Burger 0.138 x 0.178 m.",
        gt=0,
        le=2,
        source="paper: IV.C.1, di; length and width are those of the Burger's data sheet",
    )
    iou_ally: float = option(
        0.03,
        "IoU with an ally's square from which a box is removed as that ally, t of Algorithm 2.",
        gt=0,
        le=1,
        source="ours: IV.C.1 gives no number; chosen by IV.C.2, the rule is in campaigns/ally-threshold.yaml",
    )
    ally_remove: AllyRemove = option(
        "first",
        "Which boxes of one guard are removed for one ally: the first that overlaps enough, the one "
        "that overlaps most (best), or all that overlap enough.",
        source="paper: IV.C.1, Algorithm 2 breaks after one box",
    )
    iou_fuse: float = option(
        0.1,
        "IoU from which boxes of two guards are fused into one detection, t of Algorithms 3 and 4.",
        gt=0,
        le=1,
        source="ours: IV.C.2 gives no number, and no sentence binds it to t of Algorithm 2",
    )
