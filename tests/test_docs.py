"""The pages and the notebook say what the code does now."""

import ast
import importlib
import importlib.util
import re
from pathlib import Path
from types import ModuleType

import cv2
import pytest

import midnet_bench
import midnet_bench as mb
from midnet_bench.cli.options import HELP

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PACKAGE = Path(midnet_bench.__file__).parent
PAGES = [
    "README.md",
    "CONTRIBUTING.md",
    "results/README.md",
    *sorted(str(page.relative_to(ROOT)) for page in DOCS.rglob("*.md")),
]
CAMPAIGN_FILES = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "campaigns").rglob("*.yaml"))
SCREENS = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests/cli/screens").glob("*.txt"))
ROOMS = {path.stem for path in PACKAGE.iterdir()} - {"__pycache__"}
ENTRY_POINTS = {
    group
    for path in PACKAGE.rglob("*.py")
    for group in re.findall(r'entry_points="([\w.]+)"', path.read_text(encoding="utf-8"))
}
ENDINGS = {"py", "csv", "md", "js", "png", "sqlite"}  # of files' names, which have a dot as modules have
WRONG = (
    r"clean and like the paper is not to be had",
    r"the reason is one and the same",
    r"no reading among 576",
    r"among 576 readings none",
    r"the paper's 3 m window",
    r"window and memory are turtlebot3's",
    r"both contradict the paper",
    r"by calibration",
    r"(?:was|were) (?:calibrated|chosen by a rule)",
    r"what was (?:not )?fitted",
)
"""sentences that measurements have refuted, or that defaults are no longer chosen by"""

OLD_WORDS = re.compile(
    r"\b(nobody|somebody|anybody|whom|whoever|who is who|(?:is|are|was|were) told"
    r"|takes? (?:it|them)sel(?:f|ves) to be"
    r"|go(?:es)? by (?:the|its|MIDNet|what|those)|what is none|had been seen|mend(?:s|ed)? it)\b",
    re.IGNORECASE,
)
"""riddles, where the field has a word: no robot, the estimated pose, uses"""


@pytest.mark.parametrize("page", [*PAGES, *CAMPAIGN_FILES, *SCREENS])
def test_pages_comments_and_screens_are_in_plain_words(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    if page.endswith(".yaml"):
        text = "\n".join(re.findall(r"^#.*", text, flags=re.M))
    words = re.sub(r"```.*?```|`[^`]*`", "", " ".join(text.split()), flags=re.S)
    assert OLD_WORDS.findall(words) == []


OLD_DOCSTRINGS = re.compile(
    r"\b(nobody|somebody|anybody|everybody|whom|whoever|who|(?:is|are|was|were|be) (?:told|asked)"
    r"|takes? (?:it|them)sel(?:f|ves) to be|what is none)\b",
    re.IGNORECASE,
)


@pytest.mark.parametrize("room", sorted(path.name for path in PACKAGE.iterdir() if path.name[0] != "_"))
def test_docstrings_are_in_plain_words(room: str) -> None:
    path = PACKAGE / room
    for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
                assert OLD_DOCSTRINGS.findall(str(node.value.value)) == [], f"{file}:{node.lineno}"


@pytest.mark.parametrize("sentence", ["Nobody is there", "as they are told", "where it takes itself to be"])
def test_an_old_sentence_is_recognized(sentence: str) -> None:
    assert OLD_WORDS.search(sentence)


def script(name: str) -> ModuleType:
    """A module beside the pages."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_api_page_is_made_from_these_docstrings() -> None:
    assert (DOCS / "api.md").read_text(encoding="utf-8") == script("make_api").page(), "run 'make api'"


def test_the_columns_of_the_trials_tables_are_those_declared() -> None:
    text, results = (DOCS / "results.md").read_text(encoding="utf-8"), script("make_results")
    assert text == results.page(text), "run 'make api'"
    assert set(results.TABLES) <= set(results.BLOCK.findall(text))


def test_the_help_of_parameters_is_made_from_their_declarations() -> None:
    assert HELP.read_text(encoding="utf-8") == script("make_help").page(), "run 'make api'"


def test_the_sources_are_counted_from_the_declarations() -> None:
    readings = script("make_readings")
    text = readings.PAGE.read_text(encoding="utf-8")
    assert text == readings.page(text), "run 'make api'"
    assert readings.rows() in text


@pytest.mark.slow
def test_the_walkthrough_has_the_numbers_of_its_trial() -> None:
    walk = script("make_walkthrough")
    prior, frame = walk.shown_frame()
    found = frame.midnet.explanation
    kept = [len(view.kept) for view in found.views]
    removed = [one.detection.robot for one in found.removed]
    found_by_each = [kept[robot] + removed.count(robot) for robot in range(5)]
    words = " ".join((DOCS / "walkthrough.md").read_text(encoding="utf-8").split())
    assert "have {}, {}, {}, {} and {} boxes".format(*found_by_each) in words
    assert f"Of the {sum(found_by_each)} boxes {len(removed)} are removed and {sum(kept)} are left" in words
    assert f"{len(frame.midnet.detections)} boxes are left" in words
    assert removed.count(walk.GUARD_SHOWN - 1) == 2
    tree = walk.tree_of(found, mb.MIDNetSettings().iou_fuse)
    assert len(tree.root.left) == len(frame.midnet.detections)
    drawn = {
        "walk-fusion.png": walk.draw_fusion(prior, tree),
        "walk-grids.png": walk.draw_views(
            frame.observations[walk.GUARD_SHOWN - 1], found, walk.GUARD_SHOWN - 1
        ),
    }
    for name, picture in drawn.items():
        committed = cv2.imread(str(DOCS / "images" / name))[..., ::-1]
        assert cv2.absdiff(committed, picture).mean() < 1.0, "run docs/make_walkthrough.py"


def test_the_pages_are_found() -> None:
    assert {"README.md", "results/README.md", "docs/howto/arena.md", "docs/studies/duration.md"} <= {*PAGES}


@pytest.mark.parametrize("page", PAGES)
def test_every_file_that_a_page_links_to_or_names_is_there(page: str) -> None:
    path = ROOT / page
    text = path.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
        assert "://" in target or (path.parent / target).exists(), target
    for target in re.findall(r"`((?:docs|results/reference|campaigns|tests|midnet_bench)/[\w./-]+)`", text):
        assert (ROOT / target).exists(), target
    for room, rest in re.findall(r"`(\w+)(/[\w./-]*)`", text):
        if room in ROOMS - {"docs"}:
            assert (PACKAGE / f"{room}{rest}").exists(), f"{room}{rest}"


@pytest.mark.parametrize("page", PAGES)
def test_every_module_and_name_that_a_page_has_in_backticks_is_there(page: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    for name in re.findall(r"`((?:[a-z]\w*\.)+\w+)`", text):
        if name in ENTRY_POINTS or name.rpartition(".")[2] in ENDINGS:
            continue
        if name.split(".")[0] in {"midnet_bench", *ROOMS}:
            assert resolved(f"midnet_bench.{name.removeprefix('midnet_bench.')}") is not None, name


def test_the_map_from_paper_to_code_names_nothing_else() -> None:
    """There a name in any other form is a name of a module that is gone."""
    text = (DOCS / "paper-mapping.md").read_text(encoding="utf-8")
    names = re.findall(r"`(?:midnet_bench\.)?((?:[a-z]\w*\.)+\w+)`", text)
    assert len(names) > 20
    assert {name.split(".")[0] for name in names} <= {"midnet_bench", *ROOMS}


@pytest.mark.parametrize("page", PAGES)
def test_no_page_says_what_turned_out_wrong(page: str) -> None:
    for paragraph in (ROOT / page).read_text(encoding="utf-8").split("\n\n"):
        words = " ".join(paragraph.replace("*", "").lower().split())
        for wrong in WRONG:
            assert not re.search(wrong, words), wrong
        if re.search(r"falls.{0,40} in 12 of 20", words):  # the other count of second boxes stands beside it
            assert "second box" in words


@pytest.mark.parametrize(
    "sentence",
    [
        "**Clean and like the paper is not to be had.** 8 of the 576",
        "The reason is one and\nthe same: false boxes",
        "No reading among 576 is clean",
        "lie outside the paper's 3 m window",
        "Window and memory are TurtleBot3's",
        "**Both contradict the paper** in three statements.",
        "3 x 3 m, TurtleBot3's, by calibration",
        "it was chosen by a\nrule that asks",
        "**What was fitted:** seven values",
    ],
)
def test_a_wrong_sentence_is_recognized(sentence: str) -> None:
    words = " ".join(sentence.replace("*", "").lower().split())
    assert any(re.search(wrong, words) for wrong in WRONG)


def resolved(name: str) -> object:
    """The module, class, function or field of that name; None if there is none."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found: object = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if part in getattr(found, "__annotations__", {}):
                return found
            found = getattr(found, part, None)
        return found
    return None


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_the_notebook_runs_from_top_to_bottom(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import nbformat
    from nbclient import NotebookClient

    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))
    monkeypatch.setenv("LOKY_MAX_CPU_COUNT", "1")  # of the campaigns' workers, each of which costs seconds
    notebook = nbformat.read(DOCS / "midnet_bench.ipynb", as_version=4)
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(cell.outputs or cell.source.startswith("import") for cell in cells[:-1])
    for cell in cells:
        cell.source = re.sub(r"frames=\d+", "frames=4", cell.source).replace("seeds=3", "seeds=2")
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert not [output for cell in cells for output in cell.outputs if output.output_type == "error"]
