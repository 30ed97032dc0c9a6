"""The pages and the notebook say what the code does now."""

import importlib
import importlib.util
import re
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

import midnet_bench

DOCS = Path(__file__).parents[1] / "docs"


def test_the_api_page_is_made_from_these_docstrings() -> None:
    spec = importlib.util.spec_from_file_location("make_api", DOCS / "make_api.py")
    assert spec is not None
    assert spec.loader is not None
    make_api = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_api)
    assert (DOCS / "api.md").read_text(encoding="utf-8") == make_api.page(), "run 'make api'"


@pytest.mark.parametrize(
    "page", ["README.md", "CONTRIBUTING.md", *(f"docs/{p.name}" for p in DOCS.glob("*.md"))]
)
def test_every_file_that_a_page_links_to_or_names_is_there(page: str) -> None:
    path = DOCS.parent / page
    text = path.read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        assert "://" in target or (path.parent / target).exists(), target
    for target in re.findall(r"`((?:docs|results/reference|campaigns|tests)/[\w./-]+)`", text):
        assert (DOCS.parent / target).exists(), target


def test_every_name_in_the_map_from_paper_to_code_is_there() -> None:
    text = (DOCS / "paper-mapping.md").read_text(encoding="utf-8")
    names = re.findall(r"`(?:midnet_bench\.)?((?:[a-z]\w*\.)+\w+)`", text)
    rooms = {path.stem for path in Path(midnet_bench.__file__).parent.iterdir()}
    code = [name for name in names if name.split(".")[0] in rooms]
    assert len(code) > 20
    for name in code:
        assert resolved(f"midnet_bench.{name}") is not None, name


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
    monkeypatch.setenv("PYTHONPATH", str(DOCS.parent))
    notebook = nbformat.read(DOCS / "midnet_bench.ipynb", as_version=4)
    assert all(cell.outputs or cell.source.startswith("import") for cell in code_cells(notebook)[:-1])
    NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(tmp_path)}}).execute()
    assert not [
        output for cell in code_cells(notebook) for output in cell.outputs if output.output_type == "error"
    ]


def code_cells(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]
