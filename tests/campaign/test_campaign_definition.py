import itertools
from pathlib import Path

import numpy as np
import pytest

from midnet_bench.arena.arena import load_arena
from midnet_bench.campaign.definition import (
    Campaign,
    Definition,
    differences,
    load_campaign,
    override,
    parse_campaign,
    parse_settings,
    resolve,
    same_trials,
)
from midnet_bench.campaign.trial import Scalar
from midnet_bench.errors import InputError
from midnet_bench.experiments import registry
from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import save_map
from tests.campaign import coin_experiments as coins

GOOD = """
experiment: coins
grid:
  coins: [1, 2]
  bias: [0, 0.5, 1]
trials: 2
base_seed: 10
parameters:
  table: glass
"""


def campaign_file(folder: Path, text: str) -> Path:
    path = folder / "tossing.yaml"
    path.write_text(text)
    return path


def test_a_file_becomes_resolved_trials_seed_by_seed(tmp_path: Path) -> None:
    campaign = load_campaign(campaign_file(tmp_path, GOOD))

    assert campaign.name == "tossing"
    specs = list(resolve(campaign, coins).trials())
    placed = [(spec.seed, spec.parameters["coins"], spec.parameters["bias"]) for spec in specs]
    assert placed == list(itertools.product([10, 11], [1, 2], [0.0, 0.5, 1.0]))
    assert all(spec.parameters["table"] == "glass" for spec in specs)
    assert all(set(spec.parameters) == set(coins.CoinParameters.defaults()) for spec in specs)
    assert len({spec.trial_id for spec in specs}) == 12


@pytest.mark.parametrize(
    ("before", "after", "complaint"),
    [
        ("trials: 2", "trials: -2", "trials: Input should be greater than or equal to 1 (got -2)"),
        ("trials: 2", "trials: many", "trials: Input should be a valid integer (got 'many')"),
        ("trials: 2", "trials: true", "trials: Input should be a valid integer (got True)"),
        ("trials: 2", "trial_timeout_s: .inf", "trial_timeout_s: Input should be"),
        ("trials: 2", "trial_timeout_s: .nan", "trial_timeout_s: Input should be"),
        ("trials: 2", "trial_timeout_s: 1.0e+300", "trial_timeout_s: Input should be less than or equal to"),
        ("trials: 2", "name: ../../evil", "name: the results' folder is named so; give one plain name"),
        ("trials: 2", "name: ''", "name: the results' folder is named so"),
        ("trials: 2", "name: ..", "name: the results' folder is named so"),
        ("trials: 2", 'name: "a\\0b"', "name: the results' folder is named so"),
        ("trials: 2", "trails: 2", "trails: unknown key; did you mean 'trials'?"),
        ("base_seed: 10", "base_seed: -1", "base_seed: Input should be greater than or equal to 0"),
        ("experiment: coins", "experiment: coin", "unknown name 'coin'; did you mean 'coins'?"),
        ("experiment: coins", "", "experiment: Field required"),
        ("  coins: [1, 2]", "  coin: [1, 2]", "grid.coin: unknown key; did you mean 'coins'?"),
        ("  coins: [1, 2]", "  coins: []", "grid.coins: too few items"),
        ("  coins: [1, 2]", "  coins: 1", "grid.coins: Input should be a valid list (got 1)"),
        ("  coins: [1, 2]", "  coins: [1, 0]", "cell coins=0, bias=0: coins: Input should be greater"),
        (
            "  coins: [1, 2]",
            f"  coins: {[*range(1, 1001)]}\n  work_s: {[*range(1000)]}\n  trouble_seed: {[*range(1000)]}",
            "grid: 3000000000 cells, and each is checked before the first trial; give at most 10000",
        ),
        ("  coins: [1, 2]", "  table: [oak]", "parameters.table: also a factor of the grid"),
        ("  table: glass", "  tabel: glass", "parameters.tabel: unknown key; did you mean 'table'?"),
        ("  table: glass", "  work_s: -1", "parameters: work_s: Input should be greater"),
        ("  table: glass", "  table: [a, b]", "parameters.table"),
        (GOOD, "- coins", "(top level): a campaign is a mapping"),
        (GOOD, "", "(top level): "),
        (GOOD, "experiment: [", "not valid YAML"),
    ],
)
def test_a_wrong_file_is_one_line_with_file_and_key(
    tmp_path: Path, before: str, after: str, complaint: str
) -> None:
    path = campaign_file(tmp_path, GOOD.replace(before, after))

    with pytest.raises(InputError) as caught:
        resolve(load_campaign(path), coins)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert complaint in message
    assert "\n" not in message


def test_a_map_is_checked_against_the_arenas_of_the_grid_and_no_other(tmp_path: Path) -> None:
    arena = load_arena("empty")
    small = arena.model_copy(
        update={"enclosure_m": (3.0, 3.0), "walls": (((-1.5, -1.5), (1.5, -1.5), (1.5, 1.5)),)}
    )
    (tmp_path / "small.yaml").write_text(small.model_dump_json())
    save_map(OccupancyGrid(np.zeros((60, 60), np.int8), 0.05, (-1.5, -1.5)), tmp_path / "map.yaml")
    text = (
        f"experiment: detection\ngrid: {{arena: [{tmp_path}/small.yaml]}}\n"
        f"parameters: {{prior_map: {tmp_path}/map.yaml}}"
    )
    path = campaign_file(tmp_path, text)
    assert len(resolve(load_campaign(path), registry).cells) == 1
    path = campaign_file(tmp_path, text.replace("grid: {arena: [", "grid: {arena: [map1, "))
    with pytest.raises(
        InputError, match=r"tossing\.yaml: .*map\.yaml: it reaches .* cover the arena, 6 x 6 m"
    ):
        resolve(load_campaign(path), registry)


def test_settings_are_read_as_yaml_scalars() -> None:
    settings = parse_settings(["a=1", "b=0.5", "c=true", "d=word", "e=", "f=x=y", "g='1'"])

    assert settings == {"a": 1, "b": 0.5, "c": True, "d": "word", "e": None, "f": "x=y", "g": "1"}


@pytest.mark.parametrize(
    "given",
    [[one] for one in ("novalue", "=1", "a=[1, 2]", "a={", "a=2026-01-01", "a=60,", "a=,60", "a=60,,80")]
    + [["a=[1, 2],3"], ["a=1", "a=2"], ["seed=3"]],
)
def test_a_setting_that_cannot_be_read_is_quoted(given: list[str]) -> None:
    with pytest.raises(InputError, match="--set") as caught:
        parse_settings(given, is_sweep="," in given[0] and given[0] != "a=[1, 2]")
    assert given[-1] in str(caught.value)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("60,80, 99", [60, 80, 99]),
        ("60", 60),
        ("midnet,clusters(noise_m=0.02, min_returns=3)", ["midnet", "clusters(noise_m=0.02, min_returns=3)"]),
        ("a(b=[1,2], c='x,y'),d", ["a(b=[1,2], c='x,y')", "d"]),
        ("'one, two'", "one, two"),
        ("'one, two',three", ["one, two", "three"]),
        ("Peter's,Mary's", ["Peter's", "Mary's"]),
        ('\'{"a": 1, "b": [2, 3]}\'', '{"a": 1, "b": [2, 3]}'),
        ("a(b,c", "a(b,c"),
        ("true,null", [True, None]),
    ],
)
def test_commas_part_values_but_not_inside_brackets_and_quotes(text: str, values: object) -> None:
    assert parse_settings([f"key={text}"], is_sweep=True) == {"key": values}


def test_several_values_make_a_factor_behind_those_that_are_there() -> None:
    campaign = Campaign(experiment="coins", grid={"coins": [1, 2]}, parameters={"bias": 0.1})

    changed = override(campaign, {"bias": [0.2, 0.3], "coins": [4, 5, 6]})

    assert changed.grid == {"coins": [4, 5, 6], "bias": [0.2, 0.3]}
    assert changed.parameters == {}


def test_a_value_given_twice_is_run_once_and_told() -> None:
    campaign = Campaign(experiment="coins", grid={"coins": [1, 2, 1.0], "bias": [0.5]})

    resolved = resolve(campaign, coins)

    assert [cell["coins"] for cell in resolved.cells] == [1, 2]
    assert resolved.definition.grid == {"coins": [1, 2], "bias": [0.5]}
    assert resolved.notes == ["coins=1 is there 2 times; it is run once"]


def test_values_that_give_the_same_trials_are_told() -> None:
    grid = ["a", "b"]
    cells: list[dict[str, Scalar]] = [{"a": a, "b": b} for a in (1, 2, 3) for b in (1, 2)]

    assert same_trials(grid, cells, list(range(6))) == []
    (note,) = same_trials(grid, cells, [1, 2, 3, 4, 5, 1])
    assert note.startswith("a=3, b=2 gives the same trials as a=1, b=1; ")
    (note,) = same_trials(grid, cells, [1, 1, 2, 3, 4, 4])
    assert note.startswith("a=1, b=2 gives the same trials as a=1, b=1, and 1 more likewise; ")


def test_a_setting_replaces_a_parameter_or_narrows_a_factor() -> None:
    campaign = Campaign(experiment="coins", grid={"coins": [1, 2]}, parameters={"bias": 0.1})

    changed = override(campaign, {"coins": 7, "bias": 0.2}, trials=4, base_seed=0)

    assert changed.grid == {"coins": [7]}
    assert changed.parameters == {"bias": 0.2}
    assert (changed.trials, changed.base_seed) == (4, 0)
    with pytest.raises(InputError, match=r"command line: parameters\.bais: unknown key; did you mean 'bias'"):
        resolve(override(campaign, {"bais": 1}), coins)
    with pytest.raises(InputError, match="command line: trials"):
        override(campaign, {}, trials=0)


def test_a_campaign_without_a_grid_has_one_cell() -> None:
    campaign = resolve(Campaign(experiment="coins", trials=3), coins)

    assert [spec.seed for spec in campaign.trials()] == [1, 2, 3]
    assert campaign.definition.cells == 1


def defined(**changes: object) -> Definition:
    values = {"experiment": "coins", "grid": {"coins": [1, 2]}, "trials": 3, "parameters": {"bias": 0.1}}
    return resolve(Campaign.model_validate({**values, **changes}), coins).definition


def test_a_definition_survives_its_text() -> None:
    assert Definition.from_json(defined().to_json()) == defined()


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"trials": 4},
        {"grid": {"coins": [1, 2, 3]}},
        {"grid": {"coins": [3, 2, 1]}},
        {"name": "other"},
        {"trial_timeout_s": 1.0},
        {"parameters": {"bias": 0.1, "work_s": 0.0}},  # spelling a default out changes nothing
    ],
)
def test_more_trials_or_cells_extend_a_campaign(changes: dict[str, object]) -> None:
    assert differences(defined(), defined(**changes)) == []


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"trials": 2}, "trials 3 -> 2"),
        ({"base_seed": 5}, "base_seed 1 -> 5"),
        ({"grid": {"coins": [1, 3]}}, "grid.coins [1, 2] -> [1, 3]"),
        ({"parameters": {"bias": 0.2}}, "bias 0.1 -> 0.2"),
        ({"parameters": {}}, "bias 0.1 -> 0.5"),
        ({"grid": {"coins": [1, 2], "table": ["wood"]}}, "table wood -> (not set)"),
    ],
)
def test_anything_else_is_another_campaign(changes: dict[str, object], difference: str) -> None:
    assert difference in differences(defined(), defined(**changes))


def test_code_of_the_user_joins_a_factor_that_the_grid_compares() -> None:
    campaign = parse_campaign({"experiment": "coins", "grid": {"bias": ["midnet", "mine.py:First"]}}, "a")
    added = override(campaign, {"bias": "mine.py:Second(gain=2)"})
    assert added.grid["bias"] == ["midnet", "mine.py:First", "mine.py:Second(gain=2)"]
    assert override(campaign, {"bias": "midnet"}).grid["bias"] == ["midnet"]


def test_every_cell_meets_the_same_seeds() -> None:
    small = Campaign(experiment="coins", grid={"coins": [1, 2]}, trials=3)
    grown = Campaign(experiment="coins", grid={"coins": [1, 2, 3]}, trials=5)

    ids = {spec.trial_id for spec in resolve(small, coins).trials()}
    assert ids < {spec.trial_id for spec in resolve(grown, coins).trials()}
