"""`midnet-bench arena`: plans and maps become arenas, and what is wrong with one is told."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from midnet_bench.arena.arena import FOLDER, arena_names, load_arena
from midnet_bench.io.map_server import load_map
from tests.cli.command import MAP_KEYS, midnet_bench, one_line_of_complaint, worked

ROOMS = {
    "name": "two rooms",
    "plane_m": [8.0, 8.0],
    "enclosure_m": [6.0, 6.0],
    "wall_thickness_m": 0.15,
    "wall_height_m": 1.0,
    "walls": [[[-3, -3], [3, -3], [3, 3], [-3, 3], [-3, -3]], [[1, 3], [1, 1], [3, 1]]],
    "robots": {"center_m": [-1.0, -1.0], "spacing_m": 0.6},
}
SMALL = {"shape": "cylinder", "size_m": [0.5, 0.5]}


def write(folder: Path, **changes: object) -> Path:
    path = folder / "rooms.yaml"
    path.write_text(yaml.safe_dump({**ROOMS, **changes}))
    return path


def plan(folder: Path) -> Path:
    pixels = np.full((120, 160), 255, np.uint8)
    pixels[:4] = pixels[-4:] = pixels[:, :4] = pixels[:, -4:] = 0
    pixels[:70, 100:104] = 0
    cv2.imwrite(str(folder / "plan.png"), pixels)
    return folder / "plan.png"


@pytest.mark.parametrize("name", arena_names())
def test_a_packaged_arena_is_shown_with_its_comments_and_is_input_again(name: str, tmp_path: Path) -> None:
    shown = worked("arena", "show", name, folder=tmp_path)
    assert shown.stdout == (FOLDER / f"{name}.yaml").read_text()
    (tmp_path / "mine.yaml").write_text(shown.stdout)
    assert load_arena(tmp_path / "mine.yaml") == load_arena(name)
    assert midnet_bench("arena", "show", folder=tmp_path).stdout.split() == arena_names()


def test_an_arena_of_a_plan_is_guarded(tmp_path: Path) -> None:
    plan(tmp_path)
    made = worked("arena", "from-image", "plan.png", "--resolution", 0.04, folder=tmp_path)
    (tmp_path / "mine.yaml").write_text(made.stdout)
    arena = load_arena(tmp_path / "mine.yaml")
    assert arena.enclosure_m == (6.4, 4.8)
    assert len(arena.blocks) == 5
    done = midnet_bench("arena", "check", "mine.yaml", "-o", "mine.png", folder=tmp_path)
    assert (done.returncode, done.stdout) == (0, "ok (plan: 6.4 x 4.8 m, 5 pieces of wall)\n"), done.stderr
    assert cv2.imread(str(tmp_path / "mine.png")) is not None
    worked("map", "--exact", "mine.yaml", "-o", "exact.yaml", folder=tmp_path)


def test_a_scanned_plan_loses_its_margin_and_its_specks_are_named(tmp_path: Path) -> None:
    pixels = cv2.copyMakeBorder(
        cv2.imread(str(plan(tmp_path)), cv2.IMREAD_GRAYSCALE), 40, 20, 30, 30, cv2.BORDER_CONSTANT, value=255
    )
    pixels[100:105, 60:65] = 0
    pixels[10:14, 5:9] = 0  # a title in the margin
    cv2.imwrite(str(tmp_path / "scan.jpg"), pixels, [cv2.IMWRITE_JPEG_QUALITY, 95])
    scan = ("arena", "from-image", "scan.jpg", "--resolution", 0.04, "-o", "mine.yaml")
    made = worked(*scan, folder=tmp_path)
    (margin, small, beside) = made.stderr.splitlines()
    assert "7.4 x 6 m of 8.8 x 7.2 m are left" in margin
    assert "2 small pieces of wall up to 0.2 m long, at (" in small
    assert "--drop-specks 0.2 makes them floor" in small
    assert "1 piece of wall lies beside the building" in beside
    assert made.stdout.split() == ["mine.yaml", "mine.png", "mine_plan.png"]
    made = midnet_bench(*scan, "--drop-specks", 0.2, folder=tmp_path)
    assert "the blank margin of the plan is cut off: 6.4 x 4.8 m of 8.8 x 7.2 m are left" in made.stderr
    arena = load_arena(tmp_path / "mine.yaml")
    assert arena.enclosure_m == (6.4, 4.8)
    assert len(arena.blocks) == 5
    wrong = midnet_bench(*scan, "--drop-specks", -1, folder=tmp_path)
    assert "--drop-specks: -1 is out of range" in one_line_of_complaint(wrong)


def test_floor_that_no_robot_can_enter_is_named_with_its_area(tmp_path: Path) -> None:
    pixels = np.full((120, 160), 255, np.uint8)
    pixels[:4] = pixels[-4:] = pixels[:, :4] = pixels[:, 100:104] = 0
    pixels[:40, -4:] = 0  # the yard is open at the plan's edge
    cv2.imwrite(str(tmp_path / "plan.png"), pixels)
    scan = ("arena", "from-image", "plan.png", "--resolution", 0.05, "-o", "mine.yaml")
    worked(*scan, folder=tmp_path)
    done = midnet_bench("arena", "check", "mine.yaml", folder=tmp_path)
    first, last, advice = done.stdout.splitlines()
    assert first.startswith("ok (")
    assert "-o check.png" in advice
    area_m2 = float(last.removeprefix("no robot can enter ").split()[0])
    assert area_m2 == pytest.approx(2.5 * 5.3, rel=0.1)
    told = json.loads(midnet_bench("arena", "check", "mine.yaml", "--json", folder=tmp_path).stdout)
    (area,) = told["no_entry"]
    assert area["m2"] == pytest.approx(area_m2, abs=0.05)
    assert 1.0 < area["at_m"][0] < 4.0


def test_an_arena_of_a_map_lies_where_its_heading_says(tmp_path: Path) -> None:
    plan(tmp_path)
    keys = {"resolution": 0.05, "origin": [7.0, -2.0, 0.0], "negate": 0, "occupied_thresh": 0.65}
    keys |= {"free_thresh": 0.196, "image": "grey.png"}
    pixels = cv2.copyMakeBorder(
        cv2.imread(str(tmp_path / "plan.png"), cv2.IMREAD_GRAYSCALE),
        8,
        30,
        12,
        0,
        cv2.BORDER_CONSTANT,
        value=205,
    )
    pixels[50:60, 30:40] = 205  # nobody has been there
    cv2.imwrite(str(tmp_path / "grey.png"), pixels)
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(keys))
    grid = load_map(tmp_path / "map.yaml")
    for unknown, is_wall in (("wall", True), ("free", False)):
        arguments = ("arena", "from-map", "map.yaml", "--unknown", unknown, "-o", "mine.yaml")
        worked(*arguments, folder=tmp_path)
        arena = load_arena(tmp_path / "mine.yaml")
        assert arena.enclosure_m == (8.0, 6.0)
        heading = (tmp_path / "mine.yaml").read_text().splitlines()[1]
        x, y = yaml.safe_load(heading.split("origin is ")[1].split(": write")[0])[:2]
        centres = np.stack(np.meshgrid(grid.x_centers, grid.y_centers), axis=-1)
        centres = centres + np.array([x - 7.0, y + 2.0])
        inside = (np.abs(centres[..., 0]) < 4.0) & (np.abs(centres[..., 1]) < 3.0)
        gaps = [solid.distance_to(centres[inside]) for solid in arena.wall_solids()]
        known = grid.data[inside]
        assert np.array_equal(np.min(gaps, axis=0) < 0, (known == 100) | (is_wall & (known < 0)))


def test_the_picture_of_an_arena_replaces_no_other_file(tmp_path: Path) -> None:
    source = plan(tmp_path)
    before = source.read_bytes()
    (tmp_path / "mine_plan.png").write_bytes(b"a picture of somebody")
    made = worked("arena", "from-image", "plan.png", "--resolution", 0.04, "-o", "plan.yaml", folder=tmp_path)
    assert made.stdout.split() == ["plan.yaml", "plan_arena.png", "plan_plan.png"]
    made = worked("arena", "from-image", "plan.png", "--resolution", 0.04, "-o", "mine.yaml", folder=tmp_path)
    assert made.stdout.split() == ["mine.yaml", "mine.png", "mine_plan_arena.png"]
    assert (tmp_path / "mine_plan.png").read_bytes() == b"a picture of somebody"
    assert source.read_bytes() == before
    assert cv2.imread(str(tmp_path / "mine.png")) is not None
    again = worked(
        "arena", "from-image", "plan.png", "--resolution", 0.04, "-o", "plan.yaml", folder=tmp_path
    )
    assert again.stdout.split()[:2] == ["plan.yaml", "plan_arena.png"]
    assert source.read_bytes() == before


def test_floor_that_an_arena_declares_closed_is_no_fault(tmp_path: Path) -> None:
    walls = [ROOMS["walls"][0], [[1, 3], [1, 1], [3, 1]]]
    write(tmp_path, walls=walls)
    assert midnet_bench("arena", "check", "rooms.yaml", folder=tmp_path).returncode == 1
    write(tmp_path, walls=walls, no_entry_m=[[2.0, 2.0]])
    done = worked("arena", "check", "rooms.yaml", folder=tmp_path)
    first, area, _ = done.stdout.splitlines()
    assert first.startswith("ok (")
    assert area.startswith("no robot can enter 2.")
    write(tmp_path, walls=walls, no_entry_m=[[0.0, 2.0]])  # floor that guards reach
    assert midnet_bench("arena", "check", "rooms.yaml", folder=tmp_path).returncode == 1


def test_the_width_of_a_door_that_no_robot_passes_is_named(tmp_path: Path) -> None:
    # the gap is less by half a wall at each end
    walls = [ROOMS["walls"][0], [[1, 3], [1, 1], [1.8, 1]], [[2.2, 1], [3, 1]]]
    write(tmp_path, walls=walls)
    done = midnet_bench("arena", "check", "rooms.yaml", folder=tmp_path)
    assert done.returncode == 1
    fault = done.stdout.splitlines()[0]
    place, width_m = fault.split("; the widest, at (")[1].split(" m;")[0].split("), has ")
    x, y = map(float, place.split(", "))
    assert abs(x - 2.0) < 0.06
    assert abs(y - 1.0) < 0.2
    assert float(width_m) == pytest.approx(0.25, abs=0.011)


def test_a_start_too_near_to_a_wall_for_goals_is_a_fault(tmp_path: Path) -> None:
    write(tmp_path, robots={"center_m": [-2.6, 0.0]}, mobile_intruders={"count": 1, "clear_of_robots_m": 0.5})
    done = midnet_bench("arena", "check", "rooms.yaml", folder=tmp_path)
    assert "robots.center_m: less than 0.4 m from a wall or an obstacle" in done.stdout


def test_each_fault_is_a_line_with_its_place(tmp_path: Path) -> None:
    write(
        tmp_path,
        robots={"center_m": [-2.5, 0.0], "spacing_m": 0.6},
        stationary_intruders={"placed": [{**SMALL, "x_m": 2, "y_m": 2}, {**SMALL, "x_m": 0, "y_m": 2}]},
    )
    done = midnet_bench("arena", "check", "rooms.yaml", "-o", "rooms.png", folder=tmp_path)
    assert done.returncode == 1
    *starts, room, hidden, area = done.stdout.splitlines()
    assert "no robot can enter" in area
    assert all("robots: guard" in line for line in starts)
    assert "guard 2 of 2 starts at (-2.80, 0.00)" in starts[0]
    assert "a room at (1.47, 1.48) cannot be reached" in room or "a room at (1.48, 1.48)" in room
    assert "stationary_intruders.placed.0 at (2.00, 2.00): no guard can ever see it within 2.5 m" in hidden
    assert cv2.imread(str(tmp_path / "rooms.png")) is not None
    told = json.loads(midnet_bench("arena", "check", "rooms.yaml", "--json", folder=tmp_path).stdout)
    assert [one["fault"] for one in told["faults"]] == [
        line.split(": ", 1)[1] for line in done.stdout.splitlines()[:-1]
    ]
    assert told["faults"][-1]["at_m"] == [2.0, 2.0]


def test_an_intruder_behind_a_barred_door_is_seen_and_one_beside_it_is_not(tmp_path: Path) -> None:
    walls = [ROOMS["walls"][0], [[1, 3], [1, 1], [1.9, 1]], [[2.1, 1], [3, 1]]]  # a gap no Burger passes
    for place, faults in (((2.0, 1.7), 1), ((1.4, 1.4), 2)):
        placed = [{**SMALL, "size_m": [0.3, 0.3], "x_m": place[0], "y_m": place[1]}]
        write(tmp_path, walls=walls, stationary_intruders={"placed": placed})
        done = midnet_bench("arena", "check", "rooms.yaml", folder=tmp_path)
        *lines, area = done.stdout.splitlines()
        assert len(lines) == faults, done.stdout
        assert area.startswith("no robot can enter 2.")


@pytest.mark.slow
def test_no_room_for_a_layout_is_a_fault(tmp_path: Path) -> None:
    write(tmp_path, stationary_intruders={"count": 60, "clear_of_robots_m": 5.0})
    done = midnet_bench("arena", "check", "rooms.yaml", folder=tmp_path)
    assert done.returncode == 1
    assert "stationary_intruders.count: no room for 60 with seed 1" in done.stdout


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("show map3", "no arena is called 'map3'"),
        ("show none.yaml", "none.yaml: cannot be read"),
        ("check wrong.yaml", "wrong.yaml: plane_m: Field required"),
        ("from-image none.png --resolution 0.02", "none.png: cannot be read"),
        ("from-image wrong.yaml --resolution 0.02", "not a PGM (P2, P5), JPEG or PNG image"),
        ("from-image plan.png --resolution 0", "--resolution: 0 is out of range"),
        ("from-image plan.png --resolution nan", "--resolution: nan is out of range"),
        (
            "from-image plan.png --resolution 1",
            "plan.png: it is 320 x 240 m large, and an arena has at most 198 m a side",
        ),
        ("from-image white.png --resolution 0.02", "white.png: there is no wall in it"),
        ("from-image black.png --resolution 0.02", "black.png: there is no floor in it that is 0.3 m wide"),
        ("from-image plan.png --resolution 0.02 --threshold 0", "--threshold: 0 is out of range; allowed: 1"),
        ("from-image plan.png --resolution 0.02 --threshold 256", "--threshold: 256 is out of range"),
        ("from-image plan.png --resolution 0.02 --threshold dark", "--threshold: a whole number is needed"),
        ("from-image plan.png --resolution 0.02 --drop-thin -1", "--drop-thin: -1 is out of range"),
        ("from-image plan.png --resolution 0.02 --drop-thin nan", "--drop-thin: nan is out of range"),
        ("from-image plan.png --resolution 0.02 --drop-thin 9", "plan.png: there is no wall in it"),
        ("from-image plan.png --resolution 0.02 --walls grey", "'grey' is not one of 'dark', 'light'"),
        ("from-image plan.png --resolution 0.02 --robots 0", "--robots: must be at least 1"),
        ("from-image plan.png --resolution 0.02 --robots 101", "--robots: 101 is out of range"),
        ("from-image plan.png --resolution 0.02 --room 1", "--room 1: two numbers are needed"),
        ("from-image plan.png --resolution 0.02 --room 1,nan", "--room 1,nan: two numbers are needed"),
        ("from-map map.yaml --room=70,0", "map.yaml: there is no room for a guard at (70, 0)"),
        ("from-map map.yaml --robots 90", "map.yaml: 90 guards fit nowhere together; at most "),
        ("from-map wrong.yaml", "wrong.yaml: image: Field required"),
        ("from-map plan.png", "plan.png: "),
    ],
)
def test_what_no_arena_can_be_made_of_is_one_line(line: str, said: str, tmp_path: Path) -> None:
    pixels = cv2.imread(str(plan(tmp_path)), cv2.IMREAD_GRAYSCALE)
    cv2.imwrite(str(tmp_path / "plan.png"), np.repeat(np.repeat(pixels, 2, 0), 2, 1))
    cv2.imwrite(str(tmp_path / "white.png"), np.full_like(pixels, 255))
    cv2.imwrite(str(tmp_path / "black.png"), np.zeros_like(pixels))
    (tmp_path / "map.yaml").write_text(yaml.safe_dump({**MAP_KEYS, "resolution": 0.02, "image": "plan.png"}))
    (tmp_path / "wrong.yaml").write_text("name: wrong\n")
    assert said in one_line_of_complaint(midnet_bench("arena", *line.split(), folder=tmp_path))


def test_a_map_of_another_resolution_is_resampled_on_request(tmp_path: Path) -> None:
    write(tmp_path)
    fine = ("map", "--exact", "rooms.yaml", "--set", "resolution_m=0.03", "-o", "fine.yaml")
    worked(*fine, folder=tmp_path)
    trial = ("detection", "--engine", "fast", "--arena", "rooms.yaml", "--dry-run", "--map")
    assert "map --from-map FILE" in one_line_of_complaint(midnet_bench(*trial, "fine.yaml", folder=tmp_path))
    done = worked("map", "--from-map", "fine.yaml", "-o", "coarse.yaml", folder=tmp_path)
    assert done.stdout.splitlines()[0] == "161 x 161 cells of 0.05 m"
    worked(*trial, "coarse.yaml", folder=tmp_path)
    for wrong, said in (
        (("--from-map", "fine.yaml", "--exact"), "--exact has no meaning with --from-map"),
        (("--from-map", "fine.yaml", "map1"), "give either an arena"),
        (
            ("--from-map", "fine.yaml", "--set", "robots=2"),
            "--set robots: changes nothing of a resampled map",
        ),
        (("--from-map", "none.yaml"), "none.yaml: cannot be read"),
    ):
        assert said in one_line_of_complaint(midnet_bench("map", *wrong, folder=tmp_path))
