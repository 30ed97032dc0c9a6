"""What a user is likely to mistype, each answered in one line that says what to type instead."""

from pathlib import Path

import numpy as np
import pytest

from midnet_bench.grid import OccupancyGrid
from midnet_bench.io.map_server import save_map
from tests.cli.command import midnet_bench, one_line_of_complaint, worked
from tests.cli.test_cli_map import write_arena
from tests.stores import detection_store, labyrinth_store

TWO_CLASSES = "class Mine:\n    pass\n\n\nclass Helper:\n    pass\n"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("wrong")
    row = (0.9, 0.5, 0.6)
    detection_store(place / "results" / "detection", {1: dict.fromkeys(range(101, 121), row)})
    detection_store(place / "results" / "mine", {1: {1: row}})
    detection_store(place / "results" / "teams", {1: {1: row}, 5: {1: row}})
    (place / "results" / "one-trial").mkdir()
    grid = {"intruders": [1], "robots": [4, 5]}
    labyrinth_store(
        place / "results" / "one-trial" / "campaign.sqlite",
        lambda i, r, s: 1,
        seeds=1,
        grid=grid,  # type: ignore[arg-type]
    ).close()
    (place / "mine.py").write_text(TWO_CLASSES)
    (place / "empty.py").write_text("x = [\n")
    (place / "other.yaml").write_text("experiment: Detection\n")
    (place / "plan.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))
    (place / "folder.yaml").mkdir()
    write_arena(place).rename(place / "crowded.yaml")
    save_map(OccupancyGrid(np.eye(20, dtype=np.int8) * 100, 0.05, (0.0, 0.0)), place / "old.yaml")
    return place


WRONG: list[tuple[str, str]] = [
    ("detection --robots 0", "--robots 0: must be 1 to 20"),
    ("run labyrinth --robots 99", "--robots 99: must be 1 to 20"),
    ("detection --robots one", "--robots one: whole numbers are needed, such as 2 or 1,2,5"),
    ("detection --robots 1,", "--robots 1,: whole numbers are needed, such as 2 or 1,2,5"),
    ("detection --frames 0", "--frames 0: must be 1 to 1000000"),
    ("detection --intruders -1", "--intruders -1: must be 0 to 100"),
    ("labyrinth --intruders 0", "--intruders 0: must be 1 to 20"),
    ("labyrinth --frames 20", "--frames does not go with 'labyrinth', which has no such parameter"),
    ("detection --pursuit nearest", "--pursuit does not go with 'detection', which has no such parameter"),
    ("detection --set thresh_local=200", "--set thresh_local=200: must be 1 to 100"),
    ("detection --set local_size_m=3,500", "--set local_size_m=500: must be "),
    ("detection --set thresh_locl=9", "thresh_locl: unknown key; did you mean 'thresh_local'?"),
    ("detection --set thresh_local", "--set thresh_local: expected key=value"),
    ("detection --set seed=4", "give it by --seed"),
    ("detection --seeds 0", "--seeds / --trials: must be at least 1"),
    ("detection --robot waffle", "No such option: --robot (Possible options: --robot-model, "),
    ("detection --seed abc", "--seed: a whole number is needed"),
    ("detection --jobs 0", "--jobs: must be at least 1"),
    ("render --speed fast", "--speed: a number is needed"),
    ("labyrinth --set pursuit_ignores_allies=maybe", "true or false is needed"),
    ("detection --sedes 3", "No such option: --sedes"),
    ("detection --preset nearest", "'nearest' is not one of 'paper', 'best'"),
    ("detection --arena map9", "no arena is called 'map9'; did you mean 'map2'?"),
    ("detection --engine fst", "did you mean 'fast'?"),
    ("detection --detector mine.py", "mine.py"),
    ("detection --detector mine.py:Yours", "mine.py:Yours"),
    ("detection --map absent.yaml", "absent.yaml"),
    ("detection -q -v", "--quiet and --verbose"),
    ("detect", "Did you mean 'detection'?"),
    ("labyrinth --arena map1", "(the widest pair is 7.1 m); set escape_distance_m below 7"),
    ("labyrinth --set escape_distance_m=40", "map2 cannot hold the labyrinth test"),
    ("run absent.yaml", "absent.yaml: there is no such file"),
    ("check mine.py", "mine.py: which class? It defines Mine, Helper: type mine.py:Mine"),
    ("check empty.py", "empty.py: cannot be read as Python"),
    ("check midnt", "did you mean 'midnet'?"),
    ("map --from-log plan.png", "plan.png: this is an image, not a log"),
    ("map map1 --slam graph", "--slam graph maps recorded logs only"),
    ("report results/teams --x robots --format gif", "figure format 'gif': use png, svg, pdf"),
    ("report results/teams --x robots --format png -o f1.pdf", "--format png is another format"),
    ("compare results/teams", "give two or more different folders, or --by robots"),
    ("compare results/teams --by robots --baseline 3", "--baseline 3: no such value of robots"),
    (
        "compare results/detection results/mine",
        "nothing to pair: detection has seeds 101 to 120, mine has seed 1; run mine with --seed 101",
    ),
    ("compare --rank results/teams", "name a factor: --of robots"),
    ("compare --rank results/teams --of robots -o results/teams/scores.csv", "give a name that ends in .md"),
    ("arena check crowded.yaml -o crowded.yaml", "the picture is a PNG; give a name that ends in .png"),
    ("arena from-map old.yaml -o old.yaml", "the arena is made of this file; give another name"),
    ("compare --rank results/teams results/mine", "--rank ranks one campaign"),
    ("compare --exact results/mine", "no numbers are committed for a campaign of this name"),
    ("verify results/one-trial --difference 5", "--difference needs 2, so --seeds 2"),
    ("verify results/one-trial --difference 5 --robots 4", "give two team sizes, such as 4,5"),
    ("verify results/one-trial --robots 4,5", "--robots and --power go with --difference"),
    ("errors results/mine --grids out", "--grids draws one frame; give --frame"),
    ("export detection --frames 0", "--frames 0: must be 1 to 1000000"),
    ("node guard_1 --ros 3", "--ros: '3' is not one of '1', '2'"),
    ("parameters thresh_locl", "no experiment or parameter 'thresh_locl'; did you mean 'thresh_local'?"),
    ("detection -o /proc/nowhere", "/proc/nowhere"),
    (
        "detection --map map.yaml --set prior_map=exact",
        "--map map.yaml: --set prior_map=exact too; give one of the two",
    ),
    (
        "render --map map.yaml --set prior_map=exact",
        "--map map.yaml: --set prior_map=exact too; give one of the two",
    ),
    ("labyrinth --backend dusk", "dask"),
    ("labyrinth --scheduler tcp://a:1 -n", "--backend dask"),
    ("detection --frames 10,20 --set frames=20", "'frames' without --set too; give it once"),
    ("labyrinth --arena map2 --set arena=map1", "'arena' without --set too; give it once"),
    ("map map1 --robots 2 --set robots=3", "'robots' without --set too; give it once"),
    ("detection --robot-model burger,wafle -n", "unknown name 'wafle'; did you mean 'waffle'?"),
    ("detection --robot-model burger(lidar=ld20) -n", "lidar: 'ld20' is none that has a name; did you mean"),
    ("detection --set lidar_hz=0 -n", "lidar_hz=0: must be 0.5 to 1000"),
    ("detection --set obstacle_range_m=101 -n", "obstacle_range_m=101: must be above 0 and at most 100"),
    ("run labirynth", "did you mean 'labyrinth'"),
    ("run campaigns/labyrinth.yaml", "'midnet-bench run labyrinth'"),
    ("run mine.yaml", "working folder"),
    ("run results", "results: is no ordinary file"),
    ("run other.yaml", "other.yaml: experiment: unknown name 'Detection'; did you mean 'detection'?"),
    ("detection --fusion components(iou=2) -n", "components(iou=2): iou: must be at most 1 (got 2)"),
    ("detection --detector background(memory_s=0) -n", "memory_s: must be above 0 (got 0)"),
    ("detection --set thresh_local=nan -n", "thresh_local: a whole number is needed (got 'nan')"),
    ("run detection --engine ode -n", "engine: "),
    ("map", "give either an arena, such as map1, or --from-log FILE"),
    ("map --from-log run.log --robots 2", "--robots has no meaning with --from-log"),
    ("map --from-log run.log --slam graph --particles 5", "--particles has no meaning with --slam graph"),
    ("map --from-log run.log --slam graf", "'graf' is not one of 'graph', 'gmapping'"),
    ("map map1 --exact --slam gmapping", "--slam has no meaning with --exact"),
    ("map map1 --exact --robots 2", "--robots has no meaning with --exact"),
    ("map map1 --exact --no-clip", "--clip/--no-clip has no meaning with --exact"),
    ("map map1 --exact --set resolutoin_m=2", "resolution_m"),
    ("map map1 --set robtos=2", "did you mean 'robots'?"),
    ("map map1 -o /proc/nowhere", "/proc/nowhere"),
    ("map map1 -o folder.yaml", "folder.yaml"),
    ("map crowded.yaml --robots 20", "two small rooms"),
    ("export detection --format rosbag", "did you mean 'ros2'"),
    ("export detection -o trial.xyz", "trial.xyz: is no bag's name; end it in .mcap or .bag"),
    ("export detection --format ros1 -o trial.mcap", "--format ros1 is another"),
    ("export detection --where robots=1", "--where"),
    ("export labyrinth --frames 3", "--frames"),
    ("export mapping", "mapping"),
    ("export absent/detection", "absent/detection"),
    ("export detection --set oracle=pose --engine fast --set frames=2", "oracle"),
]


@pytest.mark.parametrize(("line", "said"), WRONG, ids=lambda one: str(one)[:60])
def test_a_wrong_input_is_answered_in_one_line(line: str, said: str, folder: Path) -> None:
    before = sorted(folder.rglob("*"))
    complaint = one_line_of_complaint(midnet_bench(*line.split(), folder=folder))
    assert sorted(folder.rglob("*")) == before
    assert said in complaint
    assert complaint.startswith("error: ")
    assert "Input should be" not in complaint


def test_a_number_is_a_baseline_however_it_is_written(tmp_path: Path) -> None:
    detection_store(tmp_path / "teams", {1: {1: (0.9, 0.5, 0.6)}, 5: {1: (0.9, 0.5, 0.6)}})
    done = worked("compare", "teams", "--by", "robots", "--baseline", "5.0", folder=tmp_path)
    assert "robots=1 against robots=5" in done.stdout


@pytest.mark.slow
def test_one_figure_goes_into_the_file_that_is_named(folder: Path) -> None:
    line = "report results/teams --x robots --y f1 -o out/f1.pdf"
    done = midnet_bench(*line.split(), folder=folder)
    assert (done.returncode, done.stdout) == (0, "out/f1.pdf\n"), done.stderr
    assert (folder / "out" / "f1.pdf").read_bytes().startswith(b"%PDF-")
