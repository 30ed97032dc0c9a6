"""Files and settings that cannot be used, through the real command: one line, exit code 2, no results."""

from pathlib import Path

import pytest
import yaml

from tests.cli.command import MAP_KEYS, midnet_bench, one_line_of_complaint

FREE = b"P5\n160 160\n255\n" + bytes([254]) * 25600


def map_files(pixels: bytes = FREE, **changes: object) -> dict[str, bytes]:
    return {"map.yaml": yaml.safe_dump({**MAP_KEYS, **changes}).encode(), "map.pgm": pixels}


ARENA = ("detection", "--arena", "arena.yaml")
DETECTION = ("detection", "--robots", "1", "-n")
MAP = (*DETECTION, "--map", "map.yaml")
RUN = ("run", "campaign.yaml", "-n")
LOG = ("map", "--from-log", "run.log")
HEAD = b"experiment: detection\n"


@pytest.mark.parametrize(
    ("files", "arguments", "words"),
    [
        ({}, (*DETECTION, "--set", "frames=2020-13-45"), ["--set frames=2020-13-45", "not valid YAML"]),
        ({}, (*DETECTION, "--arena", "absent.yaml"), ["arena: absent.yaml", "working folder"]),
        ({}, (*DETECTION, "--set", 'prior_map="{}"'), ["prior_map: '{}' is no map"]),
        ({}, (*DETECTION, "--set", 'arena="{}"'), ["arena: '{}': name: Field required"]),
        (
            {"plan.png": b"\x89PNG\r\n\x1a\n"},
            ("run", "plan.png", "-n"),
            ["plan.png", "an image; a YAML file is needed"],
        ),
        ({}, ("render", "--robots", "1", "--frames", "3", "--frame", "4"), ["frame: 4", "1 to 3"]),
        (
            {"campaign.yaml": HEAD + b"parameters: {frames: 5}\nparameters: {frames: 7}"},
            RUN,
            ["campaign.yaml: not valid YAML: line 3: the key 'parameters' is there twice"],
        ),
        (
            {"campaign.yaml": HEAD + b"parameters: {arena: date.yaml}", "date.yaml": b"name: 2020-13-45"},
            RUN,
            ["campaign.yaml: parameters: arena: date.yaml: not valid YAML: line 1: '2020-13-45'"],
        ),
        ({"campaign.yaml": HEAD + b"grid: {robots: [true]}"}, RUN, ["campaign.yaml", "robots", "True"]),
        ({"map.yaml": b"image: 2020-13-45"}, MAP, ["prior_map: map.yaml: not valid YAML: line 1"]),
        (map_files(b"P5\n" + b"9" * 5000 + b" 1\n255\n"), MAP, ["map.yaml: image: map.pgm: "]),
        (map_files(b"P5\n20 20\n255\n" + bytes([254]) * 400), MAP, ["map.yaml: it reaches", "not cover"]),
        (map_files(b"P5\n160 160\n255\n" + bytes(25600)), MAP, ["map.yaml: no cell is 0.4 m from walls"]),
        (map_files(image="absent.pgm"), MAP, ["absent.pgm"]),
        (map_files(FREE[:1000]), MAP, ["map.pgm"]),
        (map_files(origin=[-4.0, -4.0]), MAP, ["map.yaml", "origin"]),
        (map_files(resolution=0.1), MAP, ["prior_map", "0.1", "0.05"]),
        ({"arena.yaml": b"name: a\nplain_m: [8, 8]"}, ARENA, ["arena.yaml", "plain_m", "plane_m"]),
        ({"arena.yaml": b"name: [a"}, ARENA, ["arena.yaml", "YAML"]),
        ({"campaign.yaml": HEAD + b"gird: {}"}, RUN, ["campaign.yaml", "grid"]),
        ({"campaign.yaml": HEAD + b"parameters: {robts: 1}"}, RUN, ["campaign.yaml", "robts", "robots"]),
        ({"campaign.yaml": HEAD + b"grid: {robots: []}"}, RUN, ["campaign.yaml", "robots"]),
        ({"campaign.yaml": HEAD + b"trials: -1"}, RUN, ["campaign.yaml", "trials", "-1"]),
        ({"campaign.yaml": HEAD}, (*RUN, "--map", "map.yaml"), ["map.yaml", "cannot be read"]),
        ({}, ("map", "map1", "--robots", "0"), ["robots: ", "got 0"]),
        ({"run.log": b""}, LOG, ["run.log", "empty"]),
        ({"run.log": b"FLASER 3 1 2 3 0 0 0"}, LOG, ["run.log:1", "odometry missing"]),
        ({}, LOG, ["run.log: cannot be read: No such file"]),
    ],
)
def test_what_cannot_be_used_is_one_line(
    files: dict[str, bytes], arguments: tuple[str, ...], words: list[str], tmp_path: Path
) -> None:
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    complaint = one_line_of_complaint(midnet_bench(*arguments, folder=tmp_path))
    assert all(word in complaint for word in words), complaint
    assert len(complaint) < 400
    assert not (tmp_path / "results").exists()
