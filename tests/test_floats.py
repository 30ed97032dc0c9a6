"""Floats are added exactly or in a stated order: since Python 3.12 ``sum`` of floats rounds otherwise."""

import ast
import builtins
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

import midnet_bench
from midnet_bench.workflows.report import write_report
from tests.conftest import campaign_folder

PACKAGE = Path(midnet_bench.__file__).parent
WHOLE = {
    "(b > a if rises else b < a for a, b in zip(paired.before, paired.after, strict=True))",
    "cores.values()",
    "self.left_out.values()",
    "store.counts()",
    "outcome.unusable.values()",
    *("whole", "least", "middle", "found", "in_range", "near", "numbers", "zip(NONE, *causes, strict=True)"),
    "(2 * _ONE // ((2 * k + 1) * 3 ** (2 * k + 1)) for k in range(_PLACES // 3))",
    "self.rows[column]",
    "widths",
    "each[name]",
    "map(bool, match.touched)",
    "(self._values_in(part, known) for part in node.value)",
    "(self._values_in(part, known) for pair in node.value for part in pair)",
    "(count for (of_side, of_cause, of_cell), count in self.counts.items() "
    "if (of_side, of_cell) == (side, cell) and cause in (None, of_cause))",
    "(surveys[one.source].streams[one.scan_topic].topic.messages for one in inputs.robots)",
    "tally.scans.values()",
    "tally.skipped.values()",
    "(truth.in_range for truth in recorded.truths)",
}
"""what ``sum`` may add beside conditions and counts, since all of it is whole; floats take ``math.fsum``"""


def is_count(node: ast.expr) -> bool:
    """Whether what is added are conditions, lengths and whole numbers by their looks."""
    if isinstance(node, ast.GeneratorExp | ast.ListComp):
        return is_count(node.elt)
    if isinstance(node, ast.Call):
        function = ast.unparse(node.func)
        if function == "map":
            return ast.unparse(node.args[0]) == "len"
        return function in ("len", "any", "all", "int") or function.endswith(("count_nonzero", "is_file"))
    return (
        isinstance(node, ast.Compare | ast.BoolOp)
        or (isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not))
        or (isinstance(node, ast.Constant) and isinstance(node.value, int))
        or (isinstance(node, ast.Attribute) and node.attr.startswith("is_"))
    )


def sums(path: Path) -> list[ast.expr]:
    """What the builtin ``sum`` adds in a file, also where ``map`` calls it."""
    calls = [node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Call)]
    plain = [call.args[0] for call in calls if ast.unparse(call.func) == "sum"]
    return plain + [call.args[1] for call in calls if ast.unparse(call).startswith("map(sum, ")]


def test_sum_adds_whole_numbers_alone() -> None:
    found = {
        f"{path.relative_to(PACKAGE)}: {ast.unparse(node)}"
        for path in PACKAGE.rglob("*.py")
        if "sum" in path.read_text("utf-8")
        for node in sums(path)
        if not is_count(node) and ast.unparse(node) not in WHOLE
    }
    assert not found


def strict_sum(values: Iterable[Any], /, start: Any = 0) -> Any:
    """``sum``, which refuses to add floats where this package calls it."""
    given = [start, *values]
    if sys._getframe(1).f_globals["__name__"].startswith("midnet_bench"):
        for one in given:
            is_float = isinstance(one, float) or getattr(getattr(one, "dtype", None), "kind", "") == "f"
            assert not is_float, f"sum of floats: {one!r}"
    return SUM(given[1:], start)


SUM = builtins.sum
CAMPAIGNS: dict[str, dict[str, Any]] = {
    "detection": {
        "grid": {"detector": ["midnet", "clusters", "background"], "fusion": ["paper", "tracks"]},
        "parameters": {"engine": "fast", "frames": 2, "robots": 2, "metrics": "ospa", "record": True},
    },
    "labyrinth": {"parameters": {"engine": "fast", "robots": 2, "intruders": 1, "time_limit_s": 2}},
    "mapping": {"parameters": {"engine": "fast", "robots": 2, "time_limit_s": 2}},
}


@pytest.mark.slow
@pytest.mark.parametrize("experiment", CAMPAIGNS)
def test_no_float_is_added_by_sum_in_a_trial_and_its_report(
    experiment: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(builtins, "sum", strict_sum)
    folder = campaign_folder(tmp_path / "out", experiment=experiment, **CAMPAIGNS[experiment])
    assert write_report(folder).results.finished
