"""YAML that cannot be used is one line, whatever is wrong with it."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import Field

from midnet_bench.errors import InputError
from midnet_bench.io.checked_yaml import Spec, load_yaml, parse, read_yaml


class Inner(Spec):
    count: int = 0


class Outer(Spec):
    share: float = Field(0.5, ge=0, le=100)
    pairs: tuple[tuple[float, float], ...] = ()
    at_least_two: tuple[int, ...] = Field((1, 2), min_length=2)
    flag: bool = False
    number_or_flag: int | bool = 0
    values: dict[str, str | int | float | bool | None] = Field(default_factory=dict)
    inner: Inner = Inner()


def said(call: Any, *arguments: Any) -> str:
    with pytest.raises(InputError) as caught:
        call(*arguments)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 200
    return message


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: 1\nb: 2020-13-45", "line 2: '2020-13-45' is not a valid timestamp; if it is a text, put it in"),
        ("a: 0b_", "line 1: '0b_' is not a valid int"),
        (f"a: {'9' * 5000}", "99... is not a valid int"),
        (f"a: 0x{'f' * 5000}", "ff... is not a valid int"),
        ("a: !!bool perhaps", "'perhaps' is not a valid bool"),
        ("a: !!timestamp now", "'now' is not a valid timestamp"),
        ("[" * 200, "nested too deeply"),
        ("a: {frames: 5}\na: {frames: 7}", "line 2: the key 'a' is there twice; keep one"),
        ("a:\n  frames: 5\n  frames: 7", "line 3: the key 'frames' is there twice; keep one"),
        ("a: [1\nb: 2", "line 2: while parsing a flow sequence expected ',' or ']'"),
        ("a: \0", "unacceptable character #x0000"),
    ],
)
def test_yaml_that_cannot_be_read_names_file_and_line(tmp_path: Path, text: str, words: str) -> None:
    assert said(load_yaml, text, "f.yaml").startswith("f.yaml: not valid YAML: ")
    assert words in said(load_yaml, text, "f.yaml")
    path = tmp_path / "f.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match="not valid YAML"):
        read_yaml(path)


def test_yaml_is_read_to_a_depth_that_nobody_needs() -> None:
    assert load_yaml("[" * 99 + "7" + "]" * 99, "f.yaml")
    assert (
        said(load_yaml, "[" * 100 + "7" + "]" * 100, "f.yaml") == "f.yaml: not valid YAML: nested too deeply"
    )


def test_a_merged_key_may_be_given_again() -> None:
    text = "base: &base {a: 1, b: 2}\nmore: &more {<<: *base, b: 3}\nmost: {<<: *more, b: 4}"
    assert load_yaml(text, "f")["most"] == {"a": 1, "b": 4}


def test_a_name_that_no_file_can_have() -> None:
    assert said(read_yaml, Path("a\0b.yaml")) == r"'a\x00b.yaml': cannot be read: no file can have this name"


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"values": {"a": {"b": 1}}}, "values.a: one number, word or true/false is needed (got {'b': 1})"),
        ({"values": {"a": float("nan")}}, "values.a: a finite number is needed (got nan)"),
        ({"pairs": [[1]]}, "pairs.0.1: Field required"),
        ({"pairs": [[1, 2, 3]]}, "pairs.0: too many items; at most 2 allowed (got [1, 2, 3])"),
        ({"at_least_two": [1]}, "at_least_two: too few items; at least 2 needed (got [1])"),
        ({"pairs": 1}, "pairs: Input should be a valid list (got 1)"),
        ({"inner": None}, "inner: a mapping of keys to values is needed (got None)"),
        ("text", "(top level): a mapping of keys to values is needed (got 'text')"),
        ({"share": float("nan")}, "share: Input should be a finite number (got nan)"),
        ({"share": float("inf")}, "share: Input should be a finite number (got inf)"),
        ({"inner": {"count": 1e30}}, "inner.count: the number is too large (got 1e+30)"),
        ({"share": True}, "share: Input should be a valid number (got True)"),
        ({"inner": {"count": True}}, "inner.count: Input should be a valid integer (got True)"),
        ({"at_least_two": [1, False]}, "at_least_two: Input should be a valid integer (got [1, False])"),
        ({"pairs": [[0, True]]}, "pairs: Input should be a valid number (got [[0, True]])"),
    ],
)
def test_a_wrong_value_is_said_in_plain_words(values: Any, words: str) -> None:
    assert said(parse, Outer, values, "f.yaml") == f"f.yaml: {words}"


def test_a_list_that_holds_itself() -> None:
    refused = "f: not valid YAML: more than 200000 values, references counted each time"
    assert said(load_yaml, "&a [*a]", "f") == refused
    itself: list[object] = []
    itself.append(itself)
    assert said(parse, Outer, {"pairs": itself}, "f.yaml") == "f.yaml: nested too deeply"


def test_quoted_numbers_and_flags_are_taken() -> None:
    taken = parse(Outer, {"share": "0.25", "flag": True, "number_or_flag": True, "values": {"a": True}}, "f")
    assert (taken.share, taken.flag, taken.number_or_flag, taken.values) == (0.25, True, True, {"a": True})
