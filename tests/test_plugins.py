"""References to code, what the options that name code take, and what a trial's parameters say of it."""

import os
import pickle
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import get_type_hints

import pytest

from midnet_bench import plugins
from midnet_bench.agents.agent_settings import PATROLS
from midnet_bench.errors import InputError
from midnet_bench.plugins import (
    DETECTORS,
    FUSIONS,
    ExtensionPoint,
    PluginError,
    code_in,
    later,
    load_reference,
    read_module,
)
from midnet_bench.scoring.metric import METRICS

MINE = """
class Mine:
    def __init__(self, prior_map, range_m, away_m=0.3, name="a"):
        self.away_m, self.name = away_m, name
    def detect(self, team):
        return [[] for _ in team]

class Broken:
    def __init__(self, prior_map, range_m):
        raise KeyError("nothing")
    def detect(self, team): ...
"""


@pytest.fixture(autouse=True)
def forgets_modules() -> Iterator[None]:
    """What a test has imported from a folder of its own is not there for the next one."""
    before = {*sys.modules}
    yield
    for name in {"helper", "lazy", "parts", "parts.size", "parts.unit"} & sys.modules.keys() - before:
        del sys.modules[name]


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "mine.py"
    file.write_text(MINE)
    return file


def test_a_name_of_this_package_stands_as_it_is() -> None:
    assert DETECTORS.pinned(" midnet ") == "midnet"
    assert FUSIONS.pinned("tracks( keep_s=1 ,hits=2)") == "tracks(hits=2, keep_s=1)"
    assert FUSIONS.make("suppression(iou=0.5)") is not None


OWN = [(point, name) for point in (DETECTORS, FUSIONS, PATROLS, METRICS) for name in point.own]


@pytest.mark.parametrize(("point", "name"), OWN, ids=lambda one: getattr(one, "option", one))
def test_options_of_what_comes_with_the_package_have_ranges(point: ExtensionPoint, name: str) -> None:
    """Both ends are taken, and what lies beyond is refused by name."""
    if (place := point.own[name]) is None or not is_dataclass(kind := load_reference(place)):
        return
    kinds = get_type_hints(kind)
    for one in fields(kind):
        if not one.init or one.default is MISSING:
            continue
        if kinds[one.name] is bool:
            good, bad = ("true", "false"), ("1", "0.5", "text", "null")
            check_values(point, f"{name}({one.name}=", good, bad, one.name)
            continue
        low = one.metadata["limits"].get("ge", 1e-9)  # the others are above 0
        high = one.metadata["limits"]["le"]
        bad = (low - 1, high + 1, "text", "true")
        check_values(point, f"{name}({one.name}=", (low, high), bad, one.name)


def check_values(
    point: ExtensionPoint, start: str, good: Iterable[object], bad: Iterable[object], key: str
) -> None:
    """Which values an option takes; ``start``: what stands before them."""
    for value in good:
        point.pinned(f"{start}{value})")
    for value in bad:
        with pytest.raises(InputError, match=f"{key}: "):
            point.pinned(f"{start}{value})")


def test_an_option_may_be_true_or_false(mine: Path) -> None:
    mine.write_text(
        "from dataclasses import dataclass\n"
        "from midnet_bench.settings import option\n"
        "@dataclass\n"
        "class Mine:\n"
        "    prior_map: object\n"
        "    range_m: float\n"
        "    is_fast: bool = option(False, 'Whether it hurries.')\n"
        "    def detect(self, team):\n"
        "        return [[] for _ in team]\n"
    )
    check_values(
        DETECTORS, "mine.py:Mine(is_fast=", ("true", "false"), ("1", "0.5", "text", "null"), "is_fast"
    )
    for value in (True, False):
        pinned = DETECTORS.pinned(f"mine.py:Mine(is_fast={str(value).lower()})")
        assert DETECTORS.make(pinned, None, 2.5).is_fast is value
        assert DETECTORS.pinned(pinned) == pinned


def test_a_file_is_known_by_its_name_and_a_digest_of_its_bytes(mine: Path) -> None:
    pinned = DETECTORS.pinned("mine.py:Mine(name=b, away_m=0.5)")
    place, _, digest = pinned.partition("#")
    assert place == "mine.py:Mine(away_m=0.5, name=b)"
    assert DETECTORS.pinned(f"{mine}:Mine(away_m=0.5, name=b)") == pinned
    assert DETECTORS.pinned(pinned) == pinned
    assert code_in(["midnet", 3, None, pinned])[digest].content == mine.read_bytes()
    mine.write_text(MINE + "\n")
    assert DETECTORS.pinned("mine.py:Mine(name=b, away_m=0.5)") != pinned
    # what was pinned is what runs, whatever became of the file
    mine.unlink()
    made = DETECTORS.make(pinned, None, 2.5)
    assert (made.away_m, made.name) == (0.5, "b")


def test_an_installed_package_is_known_by_its_version() -> None:
    pinned = FUSIONS.pinned("midnet_bench.detectors.fusions:NoFusion")
    assert pinned.startswith("midnet_bench.detectors.fusions:NoFusion")
    assert FUSIONS.make(pinned).fuse([], 0.0).shape == (0, 4)
    with pytest.raises(InputError, match="what is here is"):
        FUSIONS.pinned("midnet_bench.detectors.fusions:NoFusion@99.9")


HELPED = """
import helper
from parts import size
class Mine:
    def __init__(self, prior_map, range_m):
        import lazy
        self.numbers = helper.NUMBER, size.SIDE, lazy.NUMBER
    def detect(self, team): ...
"""
FILES = {
    "mine.py": HELPED,
    "helper.py": "import json, numpy\nfrom parts.size import SIDE\nNUMBER = SIDE + 1\n",
    "parts/__init__.py": "",
    "parts/size.py": "from . import unit\nSIDE = 2 * unit.M\n",
    "parts/unit.py": "M = 10\n",
    "lazy.py": "NUMBER = 7\n",
}


def lay(folder: Path, **changed: str) -> Path:
    """The files of a plug-in in a folder, some of them changed."""
    for name, text in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_text(changed.get(name.rpartition("/")[2].removesuffix(".py"), text))
    return folder


def numbers_of(pinned: str) -> tuple[int, ...]:
    return tuple(DETECTORS.make(pinned, None, 2.5).numbers)


def test_a_file_brings_its_neighbours_and_each_of_them_counts(tmp_path: Path) -> None:
    value = f"{lay(tmp_path / 'one')}/mine.py:Mine"
    before = DETECTORS.pinned(value)
    assert numbers_of(before) == (21, 20, 7)
    assert DETECTORS.pinned(f"{lay(tmp_path / 'same')}/mine.py:Mine") == before
    changes = {"helper": "NUMBER = 1", "size": "SIDE = 3", "unit": "M = 4", "lazy": "NUMBER = 8"}
    found = [
        DETECTORS.pinned(f"{lay(tmp_path / name, **{name: text})}/mine.py:Mine")
        for name, text in changes.items()
    ]
    assert len({before, *found}) == 5
    # side by side, each has its own neighbours
    assert [*map(numbers_of, found)] == [(1, 20, 7), (4, 3, 7), (9, 8, 7), (21, 20, 8)]
    assert numbers_of(before) == (21, 20, 7)
    assert "helper" not in sys.modules


def test_neighbours_travel_to_other_processes(tmp_path: Path) -> None:
    pinned = DETECTORS.pinned(f"{lay(tmp_path)}/mine.py:Mine")
    handed = pickle.dumps(code_in([pinned]))
    shutil.rmtree(tmp_path)
    code = (
        "import pickle, sys\n"
        "from midnet_bench.plugins import DETECTORS, take_sources\n"
        "take_sources(pickle.load(sys.stdin.buffer))\n"
        f"print(DETECTORS.make({pinned!r}, None, 2.5).numbers)"
    )
    done = subprocess.run([sys.executable, "-c", code], input=handed, capture_output=True)
    assert done.stdout.decode().strip() == "(21, 20, 7)", done.stderr.decode()


def test_a_helper_on_the_path_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lay(tmp_path / "path")
    monkeypatch.syspath_prepend(tmp_path / "path")
    (tmp_path / "mine.py").write_text(HELPED)
    before = DETECTORS.pinned(f"{tmp_path}/mine.py:Mine")
    lay(tmp_path / "path", unit="M = 11")
    assert DETECTORS.pinned(f"{tmp_path}/mine.py:Mine") != before


@pytest.mark.slow
def test_a_module_of_no_distribution_is_digested_with_what_it_brings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lay(tmp_path)
    (tmp_path / "mine.py").rename(tmp_path / "my_detector_module.py")
    monkeypatch.syspath_prepend(tmp_path)
    before = DETECTORS.pinned("my_detector_module:Mine")
    assert re.fullmatch(r"my_detector_module:Mine#[0-9a-f]{12}", before)
    assert numbers_of(before) == (21, 20, 7)
    lay(tmp_path, helper="NUMBER = 1")
    with pytest.raises(InputError, match="what is here is"):
        DETECTORS.pinned(before)
    with pytest.raises(InputError, match="start a new process"):
        numbers_of(DETECTORS.pinned("my_detector_module:Mine"))


@pytest.mark.slow
def test_an_editable_package_is_digested_and_an_installed_one_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place in ("site-packages", "src"):
        package = lay(tmp_path / place) / f"own_{place[:3]}"
        package.mkdir()
        (package / "__init__.py").write_text(HELPED)
        (tmp_path / place / f"own_{place[:3]}-2.0.dist-info").mkdir()
        about = tmp_path / place / f"own_{place[:3]}-2.0.dist-info"
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: own_{place[:3]}\nVersion: 2.0\n")
        (about / "top_level.txt").write_text(f"own_{place[:3]}\nhelper\nparts\nlazy\n")
        monkeypatch.syspath_prepend(tmp_path / place)
    assert read_module("own_sit:Mine") is None
    assert load_reference("midnet_bench.errors:InputError") is InputError
    assert DETECTORS.pinned("own_sit:Mine").endswith("@2.0")
    assert re.search("#[0-9a-f]{12}$", DETECTORS.pinned("own_src:Mine"))


def test_a_package_whose_entry_points_cannot_be_read_costs_itself_and_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    for name, text in {
        "broken": b"\xff\xfe[x",
        "sound": b"[midnet_bench.detectors]\nmine = mine:Mine\n",
    }.items():
        about = tmp_path / f"{name}-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (about / "entry_points.txt").write_bytes(text)
    monkeypatch.syspath_prepend(tmp_path)
    plugins._readable_entry_points.cache_clear()
    assert "mine" in DETECTORS.names()
    assert DETECTORS.pinned("midnet") == "midnet"
    assert [record.getMessage().count("broken-1.0") for record in caplog.records] == [1]
    plugins._readable_entry_points.cache_clear()


@pytest.mark.parametrize(
    ("value", "says"),
    [
        ("midnett", "detector: unknown name 'midnett'; did you mean 'midnet'?"),
        ("midnet(thresh_local=3)", "goes by keys"),
        ("midnet#abc", "comes with midnet-bench"),
        ("clusters(noise_m=0x10)", "noise_m: Input should be a valid number (got '0x10')"),
        ("clusters(noise=1)", "no option 'noise'; did you mean 'noise_m'?"),
        ("clusters(noise_m=nan)", "noise_m: a number is needed"),
        ("clusters(noise_m)", "'noise_m' is no key=value"),
        ("clusters(noise_m=1, noise_m=2)", "there twice"),
        ("clusters(noise_m=1", "expected NAME"),
        ("", "expected NAME"),
        ("mine.py:Nobody", "no 'Nobody' in mine.py"),
        ("gone.py:Mine", "gone.py cannot be read"),
        ("mine.py:Mine#000000000000", "no file with the digest"),
        ("a:mine.py:Mine#000000000000", "no file with the digest"),
        ("mine.py:Mine(prior_map=1)", "no option 'prior_map'"),
        ("no_such_package.here:Mine", "ModuleNotFoundError"),
        ("os.path:join", "expected a class with a method 'detect'"),
    ],
)
def test_a_wrong_value_is_one_line_that_begins_with_the_option(value: str, says: str, mine: Path) -> None:
    with pytest.raises(InputError) as caught:
        DETECTORS.pinned(value)
    message = str(caught.value)
    assert message.startswith("detector: ")
    assert says in message
    assert "\n" not in message


def test_one_that_cannot_be_made_is_named(mine: Path) -> None:
    with pytest.raises(PluginError, match=r"Broken#\w+: mine.py:10 in __init__: KeyError: 'nothing'"):
        DETECTORS.make(DETECTORS.pinned("mine.py:Broken"), None, 2.5)


def test_a_file_is_executed_once_and_again_when_it_has_changed(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    file.write_text("class Thing:\n    size = 1\n")
    thing = load_reference(f"{file}:Thing")
    assert load_reference(f"{file}:Thing") is thing
    file.write_text("class Thing:\n    size = 2\n")
    assert load_reference(f"{file}:Thing").size == 2


def test_a_path_from_the_working_folder_is_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.py").write_text(
        "import dataclasses\n@dataclasses.dataclass\nclass A:\n    x: 'int' = 3\n"
    )
    monkeypatch.chdir(tmp_path)
    assert load_reference("mine.py:A")().x == 3


def test_a_later_function_is_imported_when_it_is_called(tmp_path: Path) -> None:
    half = later(f"{tmp_path}/mine.py:half")
    (tmp_path / "mine.py").write_text("def half(x, by=2):\n    return x / by\n")
    assert (half(3.0), half(3.0, by=3)) == (1.5, 1.0)


@pytest.mark.parametrize(
    ("reference", "says"),
    [
        ("os.path", "expected package.module:NAME"),
        ("os.path:", "expected package.module:NAME"),
        ("os path:join", "expected package.module:NAME"),
        ("no_such_package.module:NAME", "ModuleNotFoundError"),
        ("midnet_bench.errors:InputEror", "did you mean 'InputError'?"),
        ("nowhere.py:NAME", "nowhere.py cannot be read: No such file"),
        ("broken.py:NAME", "cannot be imported: SyntaxError"),
        ("raises.py:NAME", "cannot be imported: ZeroDivisionError"),
        ("raises.py:mine", "cannot be imported: ZeroDivisionError"),
    ],
)
def test_a_wrong_reference_is_one_line_that_begins_with_it(
    reference: str, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken.py").write_text("def f(:\n")
    (tmp_path / "raises.py").write_text("mine = 1\n1 / 0\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        load_reference(reference)
    message = str(caught.value)
    assert message.startswith(f"{reference}: ")
    assert says in message
    assert "\n" not in message


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_what_is_no_file_is_refused_at_once(tmp_path: Path, make: Callable[[Path], None]) -> None:
    make(tmp_path / "mine.py")
    with pytest.raises(InputError, match=r"mine\.py is no file; give one with Python code"):
        load_reference(f"{tmp_path / 'mine.py'}:Mine")


@pytest.mark.parametrize("text", ["x = " + "[" * 100_000, "x = " + "-" * 100_000 + "1"])
def test_a_file_that_is_nested_too_deeply_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "deep.py").write_text(text)
    with pytest.raises(InputError, match="deep"):
        load_reference(f"{tmp_path / 'deep.py'}:X")
