"""References to objects in packages and in files."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from midnet_bench.errors import InputError
from midnet_bench.plugins import later, load_reference


def test_an_object_of_a_package_is_found() -> None:
    assert load_reference("midnet_bench.errors:InputError") is InputError


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
