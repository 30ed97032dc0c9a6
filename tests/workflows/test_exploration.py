"""An exploration, on a small room, and all that is written of it."""

import json

import cv2
import numpy as np
import pytest

from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.io.map_server import load_map
from midnet_bench.workflows.maps import MadeMap, explore

ROOM = """
name: room
plane_m: [5, 4]
enclosure_m: [4, 3]
wall_thickness_m: 0.15
wall_height_m: 0.5
walls: [[[-2, -1.5], [2, -1.5], [2, 1.5], [-2, 1.5], [-2, -1.5]]]
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[MadeMap, list[tuple[float, float]]]:
    folder = tmp_path_factory.mktemp("room")
    (folder / "room.yaml").write_text(ROOM)
    parameters = MappingParameters(arena=str(folder / "room.yaml"), robots=2, time_limit_s=2)
    told: list[tuple[float, float]] = []
    files = explore(
        parameters, 1, folder / "made", clip=True, progress=lambda time_s, known: told.append((time_s, known))
    )
    return files, told


def test_progress_is_the_share_of_what_can_be_known(
    made: tuple[MadeMap, list[tuple[float, float]]],
) -> None:
    files, told = made
    times_s, known = zip(*told, strict=True)
    assert times_s == pytest.approx([1.0, 2.0, 2.0])
    assert list(known) == sorted(known)
    assert 0.3 < known[0] <= known[-1] <= 1.0
    assert files.scores is not None
    assert known[-1] == pytest.approx(files.scores.rows[0]["coverage"], abs=0.02)


def test_everything_is_written_and_opens(
    made: tuple[MadeMap, list[tuple[float, float]]],
) -> None:
    files, _ = made
    names = [path.name for path in files.files]
    assert {"map.yaml", "map_binary.yaml", "map.png", "growth.png", "growth.mp4", "robots.csv"} <= set(names)
    assert all(path.is_file() for path in files.files)
    folder = files.files[0].parent
    np.testing.assert_array_equal(load_map(folder / "map.yaml").data, files.grid.data)
    assert set(np.unique(load_map(folder / "map_binary.yaml").data).tolist()) == {0, 100}
    for name in ("map.png", "growth.png"):
        picture = cv2.imread(str(folder / name))
        assert picture is not None
        assert len(np.unique(picture.astype(np.int64) @ (1, 256, 65536))) > 20
    video = cv2.VideoCapture(str(folder / "growth.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == 20.0
    # from the first snapshot to the last in real time, and two seconds of a still picture
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == pytest.approx(60.0, abs=1.0)
    video.release()
    configuration = json.loads((folder / "configuration.json").read_text())
    assert configuration["experiment"] == "mapping"
    assert configuration["seed"] == 1
