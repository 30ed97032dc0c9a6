"""A layout for Foxglove, beside a bag: its map, scans, boxes and transforms, from above."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from midnet_bench.drawing.palette import DETECTION, GUARD, hexadecimal
from midnet_bench.geometry import Box
from midnet_bench.io.files import write_atomically
from midnet_bench.recording.files.ros_messages import MAP

ENDING = ".foxglove.json"
_CLEAR = "#00000000"
_SHOWN: dict[str, dict[str, Any]] = {
    "nav_msgs/msg/OccupancyGrid": {"colorMode": "map"},
    "sensor_msgs/msg/LaserScan": {"colorMode": "flat", "flatColor": hexadecimal(GUARD), "pointSize": 4},
    "visualization_msgs/msg/MarkerArray": {},
}
"""message type -> how a topic of it is shown; others are hidden"""
_FOREGROUND = {
    "colorMode": "custom",
    "minColor": _CLEAR,
    "maxColor": f"{hexadecimal(DETECTION)}80",
    "unknownColor": _CLEAR,
    "invalidColor": _CLEAR,
}


def write_layout(bag: Path, kinds: Mapping[str, str], floor: Box) -> Path:
    """Write ``NAME.foxglove.json`` beside a bag, and say where that is. Raises InputError: it cannot be.

    Args:
        bag: its path, which need not be there yet.
        kinds: topic -> message type of all that it holds.
        floor: what the camera looks down at, map frame, metres.
    """
    path, (x, y) = bag.with_name(bag.stem + ENDING), floor.center
    camera = {
        "perspective": False,  # the distance is then what is seen from top to bottom, and x points right
        "distance": 1.1 * max(floor.x_max - floor.x_min, floor.y_max - floor.y_min),
        "phi": 0,
        "thetaOffset": 0,
        "target": [0, 0, 0],
        "targetOffset": [x, y, 0],
        "targetOrientation": [0, 0, 0, 1],
        "fovy": 45,
        "near": 0.5,
        "far": 5000,
    }
    topics = {topic: _shown(topic, kind) for topic, kind in sorted(kinds.items())}
    panel = {"followTf": MAP, "followMode": "follow-none", "cameraState": camera, "topics": topics}
    panel |= {"scene": {"transforms": {"showLabel": False}}, "layers": {}}
    layout = {
        "configById": {"3D!midnet": panel},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": "3D!midnet",
    }
    write_atomically(path, json.dumps(layout, indent=1) + "\n")
    return path


def _shown(topic: str, kind: str) -> dict[str, Any]:
    """Costmaps cover what is below them, and each robot's own boxes repeat the team's."""
    name = topic.rpartition("/")[2]
    if kind not in _SHOWN or name in ("costmap", "boxes"):
        return {"visible": False}
    return {"visible": True, **(_FOREGROUND if name == "foreground" else _SHOWN[kind])}
