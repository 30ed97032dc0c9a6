"""Imports point one way, PyBullet stays in its room, and a look at the help costs nothing."""

import ast
import subprocess
import sys
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import midnet_bench
from midnet_bench.compiled import import_closure, with_loops

PACKAGE = Path(midnet_bench.__file__).parent

# From the ground up: a room may import the ones on lower floors. Rooms on one floor know nothing of each
# other, but for the modules of the ground floor.
FLOORS = [
    {"compiled", "elementary", "errors", "geometry", "grid", "plugins", "rng", "settings"},
    {"io"},
    {"robots"},
    {"midnet"},
    {"localization", "mapping", "navigation"},
    {"detectors"},
    {"agents"},
    {"arena"},
    {"simulation"},
    {"scoring"},
    {"campaign"},
    {"analysis"},
    {"drawing"},
    {"page"},
    {"recording"},
    {"experiments"},
    {"workflows"},
    {"cli"},
]
LEVEL = {room: level for level, rooms in enumerate(FLOORS) for room in rooms}
ABOVE_ALL = {"midnet_bench", "midnet_bench.__main__"}
"""the public names and the command: they may import everything, and no room imports them"""
LIFTED_OUT = {"numpy", "cv2", "numba"}  # the libraries that ``midnet/`` needs on a robot


def name_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


SOURCES = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}


@cache
def tree_of(name: str) -> ast.Module:
    """A module's syntax tree, parsed once."""
    return ast.parse(SOURCES[name].read_text(encoding="utf-8"))


@cache
def imports() -> dict[str, set[str]]:
    """Module -> what it imports, also inside functions and for types alone; our own ones as modules."""
    found: dict[str, set[str]] = {}
    for name in SOURCES:
        modules: set[str] = set()
        for node in ast.walk(tree_of(name)):
            if isinstance(node, ast.Import):
                modules |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{name}: a relative import"
                assert node.module is not None
                full = {f"{node.module}.{alias.name}" for alias in node.names}
                modules |= {module if module in SOURCES else node.module for module in full}
        found[name] = modules
    return found


def arrows() -> list[tuple[str, str]]:
    """(importer, imported) between the modules that stand in rooms."""
    return [
        (name, module)
        for name, modules in imports().items()
        for module in sorted(modules)
        if name not in ABOVE_ALL and module.split(".")[0] == "midnet_bench"
    ]


def room_of(name: str) -> str:
    return name.split(".")[1]


def short(importer: str, imported: str) -> str:
    return f"{importer} -> {imported}".replace("midnet_bench.", "")


def test_every_module_stands_in_a_known_room() -> None:
    assert {room_of(name) for name in SOURCES if name not in ABOVE_ALL} <= set(LEVEL)


def test_arrows_between_rooms_point_down() -> None:
    up = set()
    for importer, imported in arrows():
        if imported == "midnet_bench":  # its version number
            continue
        own, other = room_of(importer), room_of(imported)
        on_ground_floor = LEVEL[own] == LEVEL[other] == 0
        if own != other and not on_ground_floor and LEVEL[other] >= LEVEL[own]:
            up.add(short(importer, imported))
    assert not up


def test_no_modules_import_each_other_in_a_circle() -> None:
    graph: dict[str, set[str]] = {}
    for importer, imported in arrows():
        graph.setdefault(importer, set()).add(imported)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" <- ".join(error.args[1]))


def reached_from(modules: set[str]) -> set[str]:
    """``modules`` and all of ours that they import, also by way of others."""
    reached: set[str] = set()
    while modules:
        reached |= modules
        ours = {module for name in modules for module in imports()[name] if module in SOURCES}
        modules = ours - reached - ABOVE_ALL
    return reached


@pytest.mark.parametrize("room", ["detectors", "recording"])
def test_what_works_on_recordings_needs_no_simulator(room: str) -> None:
    """Not by way of other rooms either."""
    reached = reached_from({name for name in SOURCES if name not in ABOVE_ALL and room_of(name) == room})
    assert not {name for name in reached if room_of(name) in {"simulation", "agents", "arena"}}


def test_machine_code_is_anew_after_a_change_of_any_module_that_its_loops_use() -> None:
    """What a regular expression finds of imports is what Python's own parser finds, and a bit more."""
    for name in with_loops():
        assert import_closure([name]) - ABOVE_ALL >= reached_from({name}) - ABOVE_ALL
    assert set(with_loops()) == {
        name
        for name in SOURCES
        if any(
            isinstance(node, ast.FunctionDef) and "njit" in map(decorator_name, node.decorator_list)
            for node in ast.walk(tree_of(name))
        )
    }


def test_libraries_stay_where_they_belong() -> None:
    for name, modules in imports().items():
        libraries = {module.split(".")[0] for module in modules}
        if name != "midnet_bench.simulation.bullet_engine":
            assert not libraries & {"pybullet", "pybullet_data"}, name
        if name != "midnet_bench.simulation.mujoco_engine":
            assert "mujoco" not in libraries, name
        if name != "midnet_bench.compiled":  # it keeps stale machine code away
            assert not libraries & {"numba", "llvmlite"}, name
        if name.startswith("midnet_bench.midnet"):
            assert libraries <= {"midnet_bench", *LIFTED_OUT, *sys.stdlib_module_names}, name
            rooms = {room_of(module) for module in modules if module.startswith("midnet_bench.")}
            assert rooms <= {"midnet", *FLOORS[0]}, name


TRIAL_ROOMS = {
    *("agents", "arena", "detectors", "localization", "mapping", "midnet", "navigation", "robots"),
    *("scoring", "simulation"),
}
TRIAL_MODULES = {
    *(name for name in SOURCES if name not in ABOVE_ALL and room_of(name) in TRIAL_ROOMS | FLOORS[0]),
    *(
        name
        for name in SOURCES
        if name.startswith("midnet_bench.experiments") and not name.endswith("figures")
    ),
}


def test_the_robots_half_has_each_file_name_once() -> None:
    rooms = TRIAL_ROOMS | FLOORS[0]
    half = [name for name in SOURCES if name not in ABOVE_ALL and room_of(name) in rooms]
    names = [SOURCES[name].name for name in half if SOURCES[name].name != "__init__.py"]
    assert sorted(names) == sorted(set(names))


NOT_REPRODUCED = {
    "midnet_bench.elementary": "powers of integers",
    "midnet_bench.mapping.merge": "OpenCV finds features, and its sums go by the processor",
}
ROUNDED_ALIKE = {
    *("ceil", "copysign", "degrees", "fabs", "floor", "fmod", "frexp", "fsum", "inf", "isclose"),
    *("isfinite", "isinf", "isnan", "isqrt", "ldexp", "nan", "pi", "radians", "sqrt"),
}
"""of ``math``: what IEEE 754 defines to the last bit"""
PYTHONS_OWN = {"dist", "hypot"}
"""of ``math``: Python's own code, from such; in a compiled loop it would be the C library's"""
LIBRARYS = {
    *("sin", "cos", "tan", "sinc", "sinh", "cosh", "tanh", "arcsin", "arccos", "arctan", "arctan2"),
    *("arcsinh", "arccosh", "arctanh", "exp", "exp2", "expm1", "log", "log2", "log10", "log1p"),
    *("logaddexp", "cbrt", "power", "float_power", "hypot", "linalg", "dot", "vdot", "inner", "matmul"),
    *("tensordot", "einsum"),
}
"""of NumPy: what the C library, BLAS or the processor's vectors decide about"""
DRAWN_BY_LOGARITHM = {"exponential", "gamma", "normal", "standard_exponential", "standard_normal"}


def strays(name: str, tree: ast.Module) -> set[str]:
    """What a module computes with of which the last bit differs between C libraries and processors."""
    found, errors = set(), set()
    compiled = {
        inside
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef) and "njit" in map(decorator_name, function.decorator_list)
        for inside in ast.walk(function)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module in {"math", "numpy", "numpy.linalg", "cmath"}:
            found.add(f"from {node.module}")
        elif isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            found.add("@")
        elif isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.Pow):
            ends = (node.left, node.right) if isinstance(node, ast.BinOp) else (node.target, node.value)
            if not all(isinstance(end, ast.Constant) and isinstance(end.value, int) for end in ends):
                found.add("**")
        elif isinstance(node, ast.Attribute) and node.attr == "LinAlgError":
            errors.add(node.value)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node not in errors:
            of, what = node.value.id, node.attr
            allowed = ROUNDED_ALIKE if node in compiled else ROUNDED_ALIKE | PYTHONS_OWN
            if (of == "math" and what not in allowed) or (of == "np" and what in LIBRARYS):
                found.add(f"{of}.{what}")
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr in DRAWN_BY_LOGARITHM | {"dot"}
            and name != "midnet_bench.rng"
        ):
            found.add(node.func.attr)
    return found


def decorator_name(node: ast.expr) -> str:
    node = node.func if isinstance(node, ast.Call) else node
    return node.id if isinstance(node, ast.Name) else ""


@pytest.mark.slow
def test_trials_compute_with_nothing_whose_last_bit_is_a_librarys() -> None:
    found = {name: strays(name, tree_of(name)) for name in TRIAL_MODULES}
    assert {name: what for name, what in found.items() if what and name not in NOT_REPRODUCED} == {}
    assert NOT_REPRODUCED.keys() <= {name for name, what in found.items() if what}


@pytest.mark.parametrize(
    "source",
    [
        "math.sin(1.0)",
        "x ** 2",
        "x **= 0.5",
        "a @ b",
        "np.hypot(1.0, 2.0)",
        "np.linalg.inv(a)",
        "rng.standard_normal(3)",
        "from math import cos",
        "@njit\ndef f(x):\n    return math.hypot(x, 1.0)",
        "@njit\ndef f(x):\n    return math.dist(x, x)",
    ],
)
def test_a_stray_is_found(source: str) -> None:
    assert strays("a", ast.parse(source))


def test_what_is_rounded_alike_is_none() -> None:
    assert not strays("a", ast.parse("math.sqrt(2.0) + math.hypot(1.0, 2.0) + np.sqrt(a) * 2 ** 3"))


ADDING = {"sum", "nansum", "mean", "nanmean", "average", "std", "var"}
WHOLE_NUMBERS = {"fleet.groupby(keys, sort=False)['collisions'].sum"}
"""sums of columns that hold counts: they are exact anyhow"""


def additions(tree: ast.Module) -> set[str]:
    """The methods that add or average, but for ``analysis.statistics``; what is in ``int(...)`` is a count.

    Python's own ``sum`` is the matter of ``tests/test_floats.py``.
    """
    counted = {
        inside.func
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "int"
        for inside in node.args
        if isinstance(inside, ast.Call)
    }
    methods = {node for node in ast.walk(tree) if isinstance(node, ast.Attribute) and node.attr in ADDING}
    return {ast.unparse(node) for node in methods - counted} - {"statistics.mean"}


def test_what_makes_numbers_of_results_adds_floats_exactly() -> None:
    """NumPy's sums and pandas' differ with the order."""
    found = {
        name: additions(tree_of(name))
        for name in SOURCES
        if name.startswith("midnet_bench.analysis")
        or (name in TRIAL_MODULES and room_of(name) in {"experiments", "scoring"})
    }
    assert {name: sums - WHOLE_NUMBERS for name, sums in found.items() if sums - WHOLE_NUMBERS} == {}
    assert set().union(*found.values()) >= WHOLE_NUMBERS


def test_an_addition_of_floats_is_told_from_counting() -> None:
    assert additions(ast.parse("a.sum() + np.mean(a) + float(a.std())")) == {"a.sum", "np.mean", "a.std"}
    assert not additions(ast.parse("int((a > b).sum()) + math.fsum(a) + statistics.mean(a)"))


WITHOUT_PHYSICS = """
import importlib, sys
sys.modules["pybullet"] = sys.modules["mujoco"] = None
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except ImportError as error:
        print(name, "" if any(word in str(error).lower() for word in ("pybullet", "mujoco")) else error)
"""


@pytest.mark.slow
def test_what_needs_no_physics_is_imported_without_pybullet_and_mujoco() -> None:
    names = [name for name in SOURCES if not name.endswith("__main__")]
    command = [sys.executable, "-c", WITHOUT_PHYSICS, *names]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    failed = {line.strip().removeprefix("midnet_bench.") for line in done.stdout.splitlines()}
    physics = {name for name in failed if name == "simulation.bullet_engine"}
    assert failed == physics | {"simulation.mujoco_engine"}


@pytest.mark.parametrize(
    "arguments",
    [
        ["-c", "import midnet_bench as m; dir(m)"],
        ["-m", "midnet_bench", "--help"],
        ["-m", "midnet_bench", "detection", "-h"],
    ],
)
def test_importing_and_helping_load_nothing_heavy(arguments: list[str]) -> None:
    heavy = (
        "pybullet",
        "matplotlib",
        "pandas",
        "numba",
        "cv2",
        "scipy",
        "numpy",
        "pydantic",
        "yaml",
        "joblib",
    )
    command = [sys.executable, "-X", "importtime", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    loaded = {line.rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines() if "|" in line}
    assert not loaded & set(heavy)
