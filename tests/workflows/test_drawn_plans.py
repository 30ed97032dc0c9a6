"""Ten drawn plans of one flat: the options that the remarks propose give its walls, and no other."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.prior_maps import render_exact
from tests.arena import drawn_plans
from tests.arena.drawn_plans import PLANS, RESOLUTION_M, walls
from tests.cli.command import midnet_bench, worked

REMARKS = {
    "grey_door_arcs": "--threshold 64 makes it floor",
    "thin_door_arcs": "--drop-thin 0.1 makes them floor",
    "red_dimensions": "--drop-coloured makes it floor",
    "furniture": "--drop-thin 0.1 makes them floor",
    "skewed_scan": "--drop-specks 0.06 makes them floor",
    "scale_bar": "--drop-beside makes them floor",
    "grey_walls": "has 0.2",
}
"""what is said of a plan without its options, which are what is proposed"""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in {"grey_door_arcs", "red_dimensions"} else [pytest.mark.slow])
        for name in PLANS
    ],
)
def test_a_plan_gives_its_walls_and_no_other(name: str, tmp_path: Path) -> None:
    picture, options = PLANS[name]
    cv2.imwrite(str(tmp_path / "plan.png"), picture())
    command = ("arena", "from-image", "plan.png", "--resolution", RESOLUTION_M, "-o", "flat.yaml")
    if name in REMARKS:
        assert REMARKS[name] in worked(*command, folder=tmp_path).stderr
    made = worked(*command, *options, folder=tmp_path)
    assert made.stdout.split() == ["flat.yaml", "flat.png", "flat_plan.png"]
    assert cv2.imread(str(tmp_path / "flat_plan.png")) is not None
    if name == "grey_walls":  # a door of it is too narrow
        assert midnet_bench("arena", "check", "flat.yaml", folder=tmp_path).returncode == 1
        return
    worked("arena", "check", "flat.yaml", folder=tmp_path)
    arena = load_arena(tmp_path / "flat.yaml")
    grid = render_exact(arena, RESOLUTION_M)
    true = np.pad(walls()[::-1], round(1.0 / RESOLUTION_M))
    if name == "skewed_scan":
        assert arena.enclosure_m == pytest.approx((10.0, 8.0), abs=0.2)
        return
    assert arena.enclosure_m == pytest.approx((10.0, 8.0), abs=0.03)
    if grid.data.shape != true.shape:  # JPEG has moved an edge
        return
    differing = np.count_nonzero((grid.data == 100) != true)
    assert differing <= 0.02 * np.count_nonzero(true)


def test_a_blueprint_is_refused_with_the_way_on(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "plan.png"), drawn_plans.inverse())
    done = midnet_bench("arena", "from-image", "plan.png", "--resolution", RESOLUTION_M, folder=tmp_path)
    assert done.returncode == 2
    assert "--walls light" in done.stderr
