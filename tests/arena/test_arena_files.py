import math

import numpy as np
import pytest
import yaml

from midnet_bench.arena.arena import FOLDER, arena_names, load_arena
from midnet_bench.errors import InputError

MAP1 = (FOLDER / "map1.yaml").read_text(encoding="utf-8")


def test_the_arenas_of_the_package_load_by_name() -> None:
    assert arena_names() == ["empty", "map1", "map2", "office", "people", "people-pausing"]
    arenas = {name: load_arena(name) for name in arena_names()}
    assert arenas["map1"].plane_m == (8.0, 8.0)
    assert math.hypot(*arenas["map1"].enclosure_m) == pytest.approx(8.49, abs=0.01)
    assert (arenas["map1"].stationary_intruders.count, arenas["map1"].mobile_intruders.count) == (3, 5)
    assert (arenas["empty"].stationary_intruders.count, arenas["empty"].mobile_intruders.count) == (0, 0)
    assert arenas["empty"].walls == arenas["map1"].walls
    assert math.hypot(*arenas["map2"].enclosure_m) == pytest.approx(28.28, abs=0.01)


def test_an_arena_loads_by_path(tmp_path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(MAP1.replace("Map 1", "Mine"), encoding="utf-8")
    assert load_arena(path).name == "Mine"
    assert load_arena(str(path)) == load_arena(path)


def test_a_line_of_walls_becomes_one_solid_per_piece(tmp_path) -> None:
    walls = load_arena("map1").wall_solids()
    assert len(walls) == 4
    assert all(solid.length_m == pytest.approx(6.15) and solid.width_m == 0.15 for solid in walls)
    corners = np.vstack([solid.outline for solid in walls])
    assert np.abs(corners).max() == pytest.approx(3.075)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("plane_m", [8.0, -8.0], "plane_m.1: Input should be greater than 0 (got -8.0)"),
        ("plane_m", [float("inf"), 8.0], "plane_m.0: "),
        ("plane_m", [4.0, 8.0], "enclosure_m.0: larger than the plane (4 m)"),
        ("wall_height_m", 0.1, "wall_height_m: "),
        ("walls", [], "walls: "),
        ("walls", [[[0, 0], [9, 0]]], "walls.0.1: (9, 0) is off the plane, which ends at (4, 4)"),
        ("walls", [[[0, 0], [1, 0], [1, 0]]], "walls.0.2: the same point"),
        ("robots", {"centre_m": [0, 0]}, "robots.centre_m: unknown key; did you mean 'center_m'?"),
        ("robots", {"center_m": [3.5, 0]}, "robots.center_m: (3.5, 0) is not inside the enclosure"),
        ("stationary_intruders", {"count": -1}, "stationary_intruders.count: "),
        ("stationary_intruders", {"size_m": [1.0, 0.4]}, "size_m: the least size comes first"),
        ("stationary_intruders", {"shapes": ["ball"]}, "shapes.0: Input should be 'box' or 'cylinder'"),
        (
            "stationary_intruders",
            {"placed": [{"shape": "box", "x_m": 3.0, "y_m": 0.0, "size_m": [1.0, 1.0]}]},
            "stationary_intruders.placed.0: in a wall or off the plane",
        ),
        ("plane_m", [float("nan"), 8.0], "plane_m.0: Input should be a finite number (got nan)"),
        ("walls", [[[0, 0]]], "walls.0: too few items; at least 2 needed (got [[0, 0]])"),
        ("walls", [[[0, 0], [0, True]]], "walls: Input should be a valid number"),
        ("wall_thickness_m", True, "wall_thickness_m: Input should be a valid number (got True)"),
        ("mobile_intruders", {"count": "many"}, "mobile_intruders.count: "),
    ],
)
def test_a_wrong_file_is_one_line_that_names_file_and_key(tmp_path, key, value, said) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(yaml.safe_dump({**yaml.safe_load(MAP1), key: value}), encoding="utf-8")
    with pytest.raises(InputError) as error:
        load_arena(path)
    message = str(error.value)
    assert message.startswith(f"{path}: ")
    assert said in message
    assert "\n" not in message


def test_a_missing_key_a_missing_file_and_a_mistyped_name_are_said_plainly(tmp_path) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text("name: nothing else\n", encoding="utf-8")
    with pytest.raises(InputError, match="plane_m: Field required"):
        load_arena(path)
    with pytest.raises(InputError, match="cannot be read: No such file"):
        load_arena(tmp_path / "none.yaml")
    path.write_text("", encoding="utf-8")
    with pytest.raises(InputError, match=r"wrong\.yaml: \(top level\): the file is empty"):
        load_arena(path)
    with pytest.raises(InputError, match="no arena is called 'map3'; did you mean 'map"):
        load_arena("map3")
