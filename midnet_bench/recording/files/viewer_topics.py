"""What a viewer shows of a bag: the topics of a frame, simulated or recorded, and Foxglove's layout."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from midnet_bench.drawing.palette import DETECTION, FAINT_INK, GUARD, GUARD_FAINT, hexadecimal
from midnet_bench.geometry import Box
from midnet_bench.grid import OCCUPIED, OccupancyGrid
from midnet_bench.io.files import write_atomically
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.recording.files import ros_messages as ros
from midnet_bench.recording.files.ros_messages import MAP, Marked
from midnet_bench.recording.files.writer import BagWriter

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


def write_frame(
    bag: BagWriter,
    record_ns: int,
    stamp_ns: int,
    frame: Frame,
    names: Sequence[str],
    team: str = "/midnet",
    each: str = "",
) -> None:
    """Write the team's boxes, and each robot's foreground and boxes if the frame is explained.

    Args:
        bag: gets them.
        record_ns: when the messages are recorded.
        stamp_ns: the frame's time.
        frame: of the robots ``names``.
        names: of robots, in the frame's order.
        team: the topic that the team's are below.
        each: the one that those of each robot are below.
    """
    explained = frame.explanation
    removed = {one.detection for one in explained.removed} if explained else ()
    for robot, view in enumerate(explained.views if explained else ()):
        name, d = names[robot], view.d
        if d.data.size:  # a costmap off the map has nothing in common with it
            grid = OccupancyGrid(np.where(d.data, OCCUPIED, 0).astype(np.int8), d.resolution, d.origin)
            bag.write(f"{each}/{name}/foreground", record_ns, ros.occupancy_grid(stamp_ns, grid))
        marked = [
            Marked(box, name, FAINT_INK, "ally")
            if (box, robot) in removed
            else Marked(box, name, GUARD_FAINT)
            for box in view.found
        ]
        bag.write(f"{each}/{name}/boxes", record_ns, ros.markers(stamp_ns, marked))
    found_by = [names[robot] for robot in frame.robots]
    bag.write(f"{team}/detections", record_ns, ros.detections(stamp_ns, frame.detections, found_by))
    boxes = ros.detections_2d(stamp_ns, frame.detections, bag.ros)
    bag.write(f"{team}/detections_2d", record_ns, boxes)


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
