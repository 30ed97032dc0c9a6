"""Imports point one way, and a look at the help costs nothing."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import midnet_bench

PACKAGE = Path(midnet_bench.__file__).parent

# from the ground floor up; above it, rooms on one floor know nothing of each other
FLOORS = [
    {"errors", "geometry", "grid", "messages", "rng", "spec"},
    {"map_image"},
    {"map_server"},
    {"midnet"},
    {"localization", "navigation", "mapping"},
    {"simulation"},
    {"agents"},
    {"scoring"},
    {"experiments"},
    {"campaign"},
    {"report"},
    {"cli"},
]
LEVEL = {room: level for level, rooms in enumerate(FLOORS) for room in rooms}
MIDNET_MAY_IMPORT = {"numpy", "cv2", "midnet_bench"}


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_modules(path: Path) -> set[str]:
    modules: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            modules |= {f"{node.module}.{alias.name}" for alias in node.names}
    return modules


ENTRY_POINTS = {PACKAGE / "__init__.py", PACKAGE / "__main__.py"}
SOURCES = [path for path in sorted(PACKAGE.rglob("*.py")) if path not in ENTRY_POINTS]


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_down(path: Path) -> None:
    room = room_of(path)
    for module in imported_modules(path):
        parts = module.split(".")
        if parts[0] != "midnet_bench" or len(parts) < 2 or parts[1] not in LEVEL:
            continue
        other = parts[1]
        if other != room:
            on_ground_floor = LEVEL[room] == LEVEL[other] == 0
            assert on_ground_floor or LEVEL[other] < LEVEL[room], f"{room} imports {other}, not below it"


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_pybullet_stays_in_simulation(path: Path) -> None:
    if room_of(path) != "simulation":
        assert not any(module.split(".")[0] == "pybullet" for module in imported_modules(path))


def test_midnet_can_be_lifted_onto_a_robot() -> None:
    standard = sys.stdlib_module_names
    for path in (PACKAGE / "midnet").glob("*.py"):
        for module in imported_modules(path):
            assert module.split(".")[0] in MIDNET_MAY_IMPORT | standard, f"{path.name} imports {module}"


@pytest.mark.parametrize("arguments", [["-c", "import midnet_bench"], ["-m", "midnet_bench", "--help"]])
def test_importing_and_helping_load_nothing_heavy(arguments: list[str]) -> None:
    heavy = ("pybullet", "matplotlib", "pandas", "numba", "cv2", "scipy", "numpy", "pydantic")
    command = [sys.executable, "-X", "importtime", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded = {line.rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines() if "|" in line}
    assert not loaded & set(heavy)
