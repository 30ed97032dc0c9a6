"""Which prior map a trial gets: explored, exact, or a file's."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from midnet_bench.arena import arena
from midnet_bench.arena.arena import load_arena
from midnet_bench.arena.prior_maps import render_exact
from midnet_bench.campaign.definition import Campaign, resolve
from midnet_bench.campaign.trial import TrialSpec
from midnet_bench.detectors.detector_node import binary_prior
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.detection.trial import run_detection
from midnet_bench.experiments.guarded import inputs
from midnet_bench.experiments.guarded.guarded_arena import GuardedArena
from midnet_bench.experiments.guarded.inputs import prior_map_from
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import save_map


def as_explored(arena_name: str) -> OccupancyGrid:
    """What a perfect explorer brings home: the inner faces of the walls, and nothing known behind them."""
    arena = load_arena(arena_name)
    exact = render_exact(arena)
    free = (exact.data == 0).astype(np.uint8)
    _, labels = cv2.connectedComponents(free, connectivity=4)
    column, row = exact.cell_at(0.0, 0.0)
    inside = labels == labels[row, column]
    faces = ~inside & (cv2.dilate(inside.view(np.uint8), np.ones((3, 3))) > 0)
    return exact.with_data(np.select([inside, faces], [0, 100], -1).astype(np.int8))


@pytest.fixture
def packaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package folder that holds an explored map of map1 alone."""
    monkeypatch.setattr(arena, "MAPS", tmp_path)
    save_map(as_explored("map1"), tmp_path / "map1.yaml")
    return tmp_path


def test_an_explored_map_is_named_with_its_contents(packaged: Path) -> None:
    first = DetectionParameters.of(prior_map="explored")
    assert first.prior_map.startswith("explored:map1:")
    assert DetectionParameters.of(**first.flat_values()) == first
    grid = prior_map_from(first.prior_map, "map1", 0.05)
    np.testing.assert_array_equal(grid.data, as_explored("map1").data)


def test_another_explored_map_makes_other_trials(packaged: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = DetectionParameters.of(prior_map="explored")
    other = as_explored("map1")
    other.data[60, 60] = 100
    later = packaged / "later"
    later.mkdir()
    save_map(other, later / "map1.yaml")
    monkeypatch.setattr(arena, "MAPS", later)

    new = DetectionParameters.of(prior_map="explored")
    ids = {TrialSpec("detection", values.flat_values(), 1).trial_id for values in (old, new)}
    assert len(ids) == 2
    with pytest.raises(InputError, match=f"{old.prior_map}.*{new.prior_map}"):
        DetectionParameters.of(prior_map=old.prior_map)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        (partial(DetectionParameters.of, arena="empty"), r"midnet-bench map empty.*--map.*exact"),
        (partial(DetectionParameters.of, arena="own.yaml"), r"midnet-bench map ARENA\.yaml"),
        (LabyrinthParameters.of, "midnet-bench map map2"),
    ],
    ids=["packaged arena", "own arena", "labyrinth"],
)
def test_an_arena_without_an_explored_map_says_how_to_make_one(
    packaged: Path, monkeypatch: pytest.MonkeyPatch, parameters: Callable[..., object], said: str
) -> None:
    monkeypatch.chdir(packaged)
    Path("own.yaml").write_text(load_arena("empty").model_dump_json(), encoding="utf-8")
    with pytest.raises(InputError, match=said):
        parameters(prior_map="explored")


def test_each_arena_of_a_campaign_has_its_own_explored_map(packaged: Path) -> None:
    save_map(as_explored("empty"), packaged / "empty.yaml")
    campaign = Campaign(
        experiment="detection", grid={"arena": ["map1", "empty"]}, parameters={"prior_map": "explored"}
    )
    value = resolve(campaign, registry).definition.parameters["prior_map"]
    one, two = str(value).split(" | ")
    assert one.startswith("explored:map1:")
    assert two.startswith("explored:empty:")


@pytest.mark.parametrize("unknown", ["free", "occupied"])
def test_behind_a_thin_wall_is_as_much_margin_as_behind_a_thick_one(unknown: str) -> None:
    parameters = DetectionParameters.of(unknown_in_prior=unknown)
    thin = binary_prior(as_explored("map1"), parameters)
    thick = binary_prior(render_exact(load_arena("map1")), parameters)
    column, row = thin.cell_at(3.0 - 0.1, 0.0)
    assert thin.data[row, column - 8] == 255
    noise = slice(column, column + 4)  # a return up to 0.2 m behind the wall's face
    assert (thin.data[row, noise] == 0).all()
    assert (thick.data[row, noise] == 0).all()


@pytest.mark.slow
def test_guards_patrol_and_detect_on_an_explored_map_as_on_the_exact_one(packaged: Path) -> None:
    scores = {}
    for prior_map in ("explored", "exact"):
        parameters = DetectionParameters.of(engine="fast", prior_map=prior_map, frames=20)
        (scores[prior_map],) = run_detection(parameters, 1).tables["scores"]
    assert scores["explored"]["tp"]
    assert scores["explored"] == scores["exact"]


def test_nobody_is_sent_where_nothing_is_known(packaged: Path) -> None:
    with GuardedArena(DetectionParameters.of(prior_map="explored"), 1) as trial:
        known = trial.prior_map
        cells = [known.cell_at(x, y) for x, y in trial.patrol.points]
        assert all(known.data[row, column] == 0 for column, row in cells)


def test_the_default_map_is_the_explored_one_where_there_is_one_and_else_exact(
    packaged: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "midnet_bench")
    assert DetectionParameters.of().prior_map == DetectionParameters.of(prior_map="explored").prior_map
    assert caplog.messages == []
    inputs._note_exact.cache_clear()
    for _ in range(2):
        assert DetectionParameters.of(arena="people").prior_map == "exact"
    (note,) = caplog.messages
    assert note.startswith("note: no explored map of 'people'")
    with pytest.raises(InputError, match="no map 'explored'"):
        DetectionParameters.of(arena="people", prior_map="explored")
