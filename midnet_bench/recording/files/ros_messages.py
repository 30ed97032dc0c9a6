"""What we say in ROS messages, of ROS 1 and ROS 2 alike, and how a viewer shows it.

A message is a type and its fields in nested dicts. Fields that are not named are zero or empty, a turn is
none; a time is given in nanoseconds. ``writer.py`` puts messages into a bag, ``ros_node.py`` publishes them.
"""

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.drawing.palette import DETECTION, FAINT_INK, GUARD, GUARD_FAINT, RGB, hexadecimal
from midnet_bench.elementary import cos, sin
from midnet_bench.geometry import Box, LidarGeometry, Pose2D
from midnet_bench.grid import OCCUPIED, OccupancyGrid
from midnet_bench.io.files import write_atomically
from midnet_bench.midnet.pipeline import Frame

MAP = "map"  # the frame of all poses
CUBE, TEXT = 1, 9  # visualization_msgs/Marker.type
DELETE_ALL = 3  # visualization_msgs/Marker.action
BOX_HEIGHT_M = 0.3
LABEL_M = 0.2  # height of a capital letter
LAYOUT_ENDING = ".foxglove.json"

Fields = Mapping[str, Any]


class Message(NamedTuple):
    """One message of any type."""

    kind: str  # such as ``sensor_msgs/msg/LaserScan``
    fields: Fields


class Marked(NamedTuple):
    """A box as a viewer shows it."""

    box: Box  # map frame, metres
    space: str  # its ``ns``: the robot or intruder it belongs to
    color: RGB
    label: str = ""


def ros_name(name: str) -> str:
    """``guard_1`` of ``guard 1``: letters, digits and underscores are what ROS takes in names."""
    plain = "".join(letter if letter.isascii() and letter.isalnum() else "_" for letter in name)
    return plain if plain[:1].isalpha() else f"x{plain}"


def header(frame: str, stamp_ns: int) -> Fields:
    """std_msgs/Header."""
    return {"stamp": stamp_ns, "frame_id": frame}


def turn(yaw_rad: float) -> Fields:
    """geometry_msgs/Quaternion about the vertical axis."""
    return {"z": sin(yaw_rad / 2.0), "w": cos(yaw_rad / 2.0)}


def pose_fields(pose: Pose2D) -> Fields:
    """geometry_msgs/Pose on the floor."""
    return {"position": {"x": pose.x, "y": pose.y}, "orientation": turn(pose.yaw)}


def pose_stamped(stamp_ns: int, pose: Pose2D) -> Message:
    """geometry_msgs/PoseStamped, map frame."""
    fields = {"header": header(MAP, stamp_ns), "pose": pose_fields(pose)}
    return Message("geometry_msgs/msg/PoseStamped", fields)


def transforms(stamp_ns: int, placed: Iterable[tuple[str, str, Pose2D]]) -> Message:
    """tf2_msgs/TFMessage of (parent frame, child frame, the child's pose in the parent)."""
    every = [
        {
            "header": header(parent, stamp_ns),
            "child_frame_id": child,
            "transform": {"translation": {"x": pose.x, "y": pose.y}, "rotation": turn(pose.yaw)},
        }
        for parent, child, pose in placed
    ]
    return Message("tf2_msgs/msg/TFMessage", {"transforms": every})


def odometry(
    stamp_ns: int, child: str, pose: Pose2D, linear_mps: float, angular_radps: float, frame: str = MAP
) -> Message:
    """nav_msgs/Odometry: the pose of ``child`` in ``frame``, velocities in ``child``."""
    fields = {
        "header": header(frame, stamp_ns),
        "child_frame_id": child,
        "pose": {"pose": pose_fields(pose)},
        "twist": {"twist": {"linear": {"x": linear_mps}, "angular": {"z": angular_radps}}},
    }
    return Message("nav_msgs/msg/Odometry", fields)


def laser_scan(
    frame: str, stamp_ns: int, ranges_m: npt.NDArray[np.float64], lidar: LidarGeometry, period_s: float
) -> Message:
    """sensor_msgs/LaserScan with numbers of 32 bits; all beams of a scan leave at its stamp."""
    fields = {
        "header": header(frame, stamp_ns),
        "angle_min": lidar.angle_min_rad,
        "angle_max": lidar.angle_min_rad + lidar.angle_increment_rad * (lidar.beams - 1),
        "angle_increment": lidar.angle_increment_rad,
        "scan_time": period_s,
        "range_min": lidar.range_min_m,
        "range_max": lidar.range_max_m,
        "ranges": ranges_m.astype(np.float32),
    }
    return Message("sensor_msgs/msg/LaserScan", fields)


def occupancy_grid(stamp_ns: int, grid: OccupancyGrid) -> Message:
    """nav_msgs/OccupancyGrid of an int8 grid, map frame; row 0 is the lowest y there, too."""
    origin = pose_fields(Pose2D(*grid.origin, 0.0))
    size = {"width": grid.width, "height": grid.height}
    info = {"resolution": grid.resolution, **size, "origin": origin}
    fields = {"header": header(MAP, stamp_ns), "info": info, "data": grid.data.reshape(-1)}
    return Message("nav_msgs/msg/OccupancyGrid", fields)


def markers(stamp_ns: int, marked: Iterable[Marked]) -> Message:
    """visualization_msgs/MarkerArray: a cube for each box, in the place of all that the topic showed before.

    Ids count up within a space; a label is a text of the same space above its cube.
    """
    shown: list[Fields] = [{"header": header(MAP, stamp_ns), "action": DELETE_ALL}]
    used: dict[str, int] = {}
    for box, space, color, label in marked:
        middle, (red, green, blue) = dict(zip("xy", box.center, strict=True)), (x / 255.0 for x in color)
        cube = {
            "type": CUBE,
            "pose": {"position": {**middle, "z": BOX_HEIGHT_M / 2.0}},
            "scale": {"x": box.x_max - box.x_min, "y": box.y_max - box.y_min, "z": BOX_HEIGHT_M},
            "color": {"r": red, "g": green, "b": blue, "a": 0.6},
        }
        name = {
            "type": TEXT,
            "pose": {"position": {**middle, "z": BOX_HEIGHT_M + LABEL_M}},
            "scale": {"z": LABEL_M},
            "color": {"r": red, "g": green, "b": blue, "a": 1.0},
            "text": label,
        }
        for one in (cube, name) if label else (cube,):
            number = used[space] = used.get(space, -1) + 1
            shown.append({"header": header(MAP, stamp_ns), "ns": space, "id": number, **one})
    return Message("visualization_msgs/msg/MarkerArray", {"markers": shown})


def detections(stamp_ns: int, boxes: Sequence[Box], found_by: Sequence[str]) -> Message:
    """The team's boxes as markers, each in the space of the robot that found it."""
    marked = (Marked(box, name, DETECTION) for box, name in zip(boxes, found_by, strict=True))
    return markers(stamp_ns, marked)


def detections_2d(stamp_ns: int, boxes: Sequence[Box], ros: int) -> Message:
    """vision_msgs/Detection2DArray, map frame, metres instead of pixels; ``ros``: 1 or 2, which differ."""
    head, certain = header(MAP, stamp_ns), {"score": 1.0}
    result = certain if ros == 1 else {"hypothesis": {"class_id": "intruder", **certain}}
    every = []
    for box in boxes:
        middle: Fields = dict(zip("xy", box.center, strict=True))
        size = {"size_x": box.x_max - box.x_min, "size_y": box.y_max - box.y_min}
        bbox = {"center": middle if ros == 1 else {"position": middle}, **size}
        every.append({"header": head, "results": [result], "bbox": bbox})
    return Message("vision_msgs/msg/Detection2DArray", {"header": head, "detections": every})


def frame_messages(
    stamp_ns: int, frame: Frame, names: Sequence[str], ros: int, team: str = "/midnet", each: str = ""
) -> Iterator[tuple[str, Message]]:
    """Topics and messages of a frame: each robot's foreground and boxes if it is explained, the team's boxes.

    Args:
        stamp_ns: the frame's time.
        frame: of the robots ``names``.
        names: of robots, in the frame's order.
        ros: 1 or 2.
        team: the topic that the team's are below.
        each: the one that those of each robot are below.
    """
    explained = frame.explanation
    removed = {one.detection for one in explained.removed} if explained else ()
    for robot, view in enumerate(explained.views if explained else ()):
        name, d = names[robot], view.d
        if d.data.size:  # a costmap off the map has nothing in common with it
            grid = OccupancyGrid(np.where(d.data, OCCUPIED, 0).astype(np.int8), d.resolution, d.origin)
            yield f"{each}/{name}/foreground", occupancy_grid(stamp_ns, grid)
        looks = [(FAINT_INK, "ally") if (box, robot) in removed else (GUARD_FAINT, "") for box in view.found]
        marked = [Marked(box, name, *look) for box, look in zip(view.found, looks, strict=True)]
        yield f"{each}/{name}/boxes", markers(stamp_ns, marked)
    found_by = [names[robot] for robot in frame.robots]
    yield f"{team}/detections", detections(stamp_ns, frame.detections, found_by)
    yield f"{team}/detections_2d", detections_2d(stamp_ns, frame.detections, ros)


_SHOWN: dict[str, dict[str, Any]] = {
    "nav_msgs/msg/OccupancyGrid": {"colorMode": "map"},
    "sensor_msgs/msg/LaserScan": {"colorMode": "flat", "flatColor": hexadecimal(GUARD), "pointSize": 4},
    "visualization_msgs/msg/MarkerArray": {},
}
"""message type -> how Foxglove shows a topic of it; others are hidden"""
_CLEAR = "#00000000"
_FOREGROUND = {
    "colorMode": "custom",
    "minColor": _CLEAR,
    "maxColor": f"{hexadecimal(DETECTION)}80",
    "unknownColor": _CLEAR,
    "invalidColor": _CLEAR,
}


def write_layout(bag: Path, kinds: Mapping[str, str], floor: Box) -> None:
    """Write ``NAME.foxglove.json`` beside a bag. Raises InputError: it cannot be.

    Args:
        bag: its path, which need not be there yet.
        kinds: topic -> message type of all that it holds.
        floor: what the camera looks down at, map frame, metres.
    """
    camera = {
        "perspective": False,  # the distance is then what is seen from top to bottom, and x points right
        "distance": 1.1 * max(floor.x_max - floor.x_min, floor.y_max - floor.y_min),
        "phi": 0,
        "thetaOffset": 0,
        "target": [0, 0, 0],
        "targetOffset": [*floor.center, 0],
        "targetOrientation": [0, 0, 0, 1],
        "fovy": 45,
        "near": 0.5,
        "far": 5000,
    }
    topics: dict[str, Fields] = {}
    for topic, kind in sorted(kinds.items()):
        name = topic.rpartition("/")[2]
        # costmaps cover what is below them, and each robot's own boxes repeat the team's
        is_shown = kind in _SHOWN and name not in ("costmap", "boxes")
        look = _FOREGROUND if name == "foreground" else _SHOWN.get(kind, {})
        topics[topic] = {"visible": True, **look} if is_shown else {"visible": False}
    panel = {"followTf": MAP, "followMode": "follow-none", "cameraState": camera, "topics": topics}
    panel |= {"scene": {"transforms": {"showLabel": False}}, "layers": {}}
    layout = {
        "configById": {"3D!midnet": panel},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": "3D!midnet",
    }
    write_atomically(bag.with_name(bag.stem + LAYOUT_ENDING), json.dumps(layout, indent=1) + "\n")
