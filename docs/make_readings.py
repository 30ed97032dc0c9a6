"""Writes the table of sources into ``midnet_bench/docs/readings.md`` from the declarations: ``make api``."""

import re
from collections import Counter
from collections.abc import Mapping

from midnet_bench.cli.inputs import READINGS
from midnet_bench.experiments.detection.parameters import DetectionParameters
from midnet_bench.experiments.labyrinth.parameters import LabyrinthParameters
from midnet_bench.experiments.mapping.parameters import MappingParameters
from midnet_bench.settings import SOURCES, Leaf, Settings, all_values

PAGE = READINGS
PARTS: Mapping[str, tuple[type[Settings], ...]] = {
    "all": (DetectionParameters, LabyrinthParameters, MappingParameters),
    "detection": (DetectionParameters,),
    "labyrinth": (LabyrinthParameters,),
    "mapping": (MappingParameters,),
}
"""column of the table -> the parameters that it counts"""
ELSEWHERE = {
    "costmap.resolution",  # resolution_m, which the prior map shares
    "costmap.track_unknown",  # unknown_in_local
    "gmapping.resolution_m",  # resolution_m
    "navigator.global_costmap.resolution",  # resolution_m
    "navigator.global_costmap.size_m",  # it has the map's size
    "navigator.global_costmap.centered",
}
"""values that cannot be set where they stand: another option decides them, or nothing reads them"""
OFF = "ours: off"
ABOUT = {
    "paper": "its words, with the section",
    "turtlebot3": "navigation files of release 0.2.1, with file and key",
    "turtlebot3 1.0.0": "the files of May 2018, where a value of 0.2.1 does not work (below)",
    "package": "default of a ROS package, the robot's Gazebo description, a data sheet",
    "ours": "a choice, with its reason",
    OFF: "no effect unless another option is set",
}
_ROWS = re.compile(r"(?<=^\| --- \| --- \| --- \| --- \| --- \|\n)(?:^\| (?:`|sum).*\n)+", re.M)


def defaults(part: str) -> Mapping[tuple[str, str, str], Leaf]:
    """Each value once: (key, or path of one that cannot be set; value; source) -> its declaration."""
    return {
        (name_of(leaf), str(leaf.default), leaf.source): leaf
        for parameters in PARTS[part]
        for leaf in all_values(parameters)
        if name_of(leaf) not in ELSEWHERE
    }


def name_of(leaf: Leaf) -> str:
    """Its key, or the path of one that cannot be set."""
    return leaf.key or ".".join(leaf.path)


def kind_of(source: str) -> str:
    """What the source begins with."""
    return OFF if source.startswith(OFF) else source.partition(": ")[0]


def rows() -> str:
    """The rows of the table, Markdown."""
    counts = {part: Counter(kind_of(source) for _, _, source in defaults(part)) for part in PARTS}
    lines = [
        f"| `{kind}`: {ABOUT[kind]} | " + " | ".join(str(counts[part][kind]) for part in PARTS) + " |"
        for kind in (*SOURCES, OFF)
    ]
    lines.append("| sum | " + " | ".join(str(counts[part].total()) for part in PARTS) + " |")
    return "\n".join(lines) + "\n"


def page(text: str) -> str:
    """The page, with the rows made anew."""
    return _ROWS.sub(rows(), text, count=1)


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
