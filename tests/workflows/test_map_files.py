"""Where the files of a map go."""

from pathlib import Path

from midnet_bench.workflows.maps import MapFiles


def test_a_folder_gets_plain_names_and_a_named_map_has_its_name_on_all(tmp_path: Path) -> None:
    folder = MapFiles.at(tmp_path / "flat")
    assert (folder.map.name, folder.binary.name, folder.named("robots.csv").name) == (
        "map.yaml",
        "map_binary.yaml",
        "robots.csv",
    )
    beside = MapFiles.at(tmp_path / "new" / "flat.yml")
    assert (tmp_path / "new").is_dir()
    assert [path.relative_to(tmp_path / "new").name for path in (beside.map, beside.binary)] == [
        "flat.yml",
        "flat_binary.yml",
    ]
    assert beside.named("robots.csv") == tmp_path / "new" / "flat_robots.csv"
