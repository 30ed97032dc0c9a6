"""``setup.yaml``: what is written is read again, files are found beside it, and the docs know every key."""

import re
from pathlib import Path

import pytest

from midnet_bench.errors import InputError
from midnet_bench.recording.setup import EVERY, RecordingSetup, by_name
from tests.cli.command import REPOSITORY

PAGE = REPOSITORY / "docs" / "recordings.md"
FULL = RecordingSetup().changed(
    {
        "map": "/map",
        "scan": {"front": "/f/scan", "back": "/b/scan"},
        "pose": {EVERY: "tf", "back": "/b/pose"},
        "mount": {"front": [0.1, -0.2, 90.0]},
        "mirrored": {"back": True},
        "clock": "record",
        "delay_s": 0.05,
        "offset_s": {"second": -1e-5},
        "no_return": {"zero": "invalid"},
        "allies": {"red": {"topic": "/red"}, "blue": {"topic": "/blue", "diameter_m": 0.3}},
        "truth": {"green": "/green"},
        "sector_deg": [-30, 30],
        "settings": {"obstacle_range_m": 4.0, "local_map": "single_scan", "deflate_boxes": True},
        "localize": True,
    }
)


@pytest.mark.parametrize("setup", [RecordingSetup(), FULL])
def test_a_written_setup_is_read_again(setup: RecordingSetup, tmp_path: Path) -> None:
    path = tmp_path / "setup.yaml"
    path.write_text(setup.changed({"clock": "record"}).to_yaml(tmp_path))
    assert RecordingSetup.load(path) == setup.changed({"clock": "record"})


def test_files_are_looked_for_beside_the_setup(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "er"
    folder.mkdir(parents=True)
    for name in ("map.yaml", "truth.csv"):
        (tmp_path / name).write_text("")
    setup = RecordingSetup().changed(
        {"map": str(tmp_path / "map.yaml"), "truth": str(tmp_path / "truth.csv")}
    )
    text = setup.to_yaml(folder)
    assert 'map: "../../map.yaml"' in text
    assert str(tmp_path) not in text
    (folder / "setup.yaml").write_text(text)
    again = RecordingSetup.load(folder / "setup.yaml")
    assert Path(again.map or "").resolve() == tmp_path / "map.yaml"
    assert Path(again.truth[EVERY]).resolve() == tmp_path / "truth.csv"


def test_one_value_is_every_robot_s_and_a_name_s_own_counts_more() -> None:
    assert FULL.of_each("pose", ["front", "back"]) == {"front": "tf", "back": "/b/pose"}
    assert FULL.of_each("mount", ["front", "back"]) == {"front": (0.1, -0.2, 90.0)}
    assert FULL.of_each("delay_s", ["a", "b"]) == {"a": 0.05, "b": 0.05}
    with pytest.raises(InputError, match=r"mount: front: .*did you mean 'frnt'"):
        FULL.of_each("mount", ["frnt"])
    assert FULL.no_return == {"zero": "nothing"}
    assert by_name(["tf", "a=/a=b"], "--pose") == {EVERY: "tf", "a": "/a=b"}
    with pytest.raises(InputError, match="twice"):
        by_name(["tf", "/pose"], "--pose")


def test_the_page_has_every_key_and_its_example_is_a_setup() -> None:
    page = PAGE.read_text(encoding="utf-8")
    section = page[page.index("## setup.yaml") :]
    for key in set(RecordingSetup.model_fields) - {"unmapped"}:
        assert re.search(rf"`[^`]*\b{key}\b[^`]*`", section), key
    (example,) = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    assert "mount: [-0.153, 0.021, 0.37]" in example
