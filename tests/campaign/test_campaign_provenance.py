"""Where numbers come from: what is said of runs on other interpreters."""

from midnet_bench.campaign.provenance import collect, versions_note


def test_another_python_or_numpy_is_said_in_a_line() -> None:
    here = collect(1)
    assert versions_note([here, here]) == []
    other = {**here, "python": "CPython 3.99.1"}
    (note,) = versions_note([here, other])
    assert "CPython 3.99 with NumPy" in note
    (note,) = versions_note([here, {**here, "libraries": {"numpy": "9.1.0"}}, other])
    assert "3 interpreters" in note
