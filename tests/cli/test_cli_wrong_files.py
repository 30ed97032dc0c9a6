"""Files and settings that cannot be used, through the real command: one line, exit code 2, no results."""

from pathlib import Path

import pytest
import yaml

from tests.cli.command import MAP_KEYS, midnet_bench, one_line_of_complaint


def map_files(image: bytes) -> dict[str, bytes]:
    return {"map.yaml": yaml.safe_dump(MAP_KEYS).encode(), "map.pgm": image}


DETECTION = ("detection", "--robots", "1", "-n")
MAP = (*DETECTION, "--map", "map.yaml")
RUN = ("run", "campaign.yaml", "-n")
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
