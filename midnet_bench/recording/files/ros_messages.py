"""What we say in ROS messages, of ROS 1 and ROS 2 alike: a type, and its fields in nested dicts.

Fields that are not named are zero or empty, a turn is none; a time is given in nanoseconds.
``writer.py`` puts them into a bag, ``ros_node.py`` publishes them.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from midnet_bench.drawing.palette import DETECTION, RGB
from midnet_bench.elementary import cos, sin
from midnet_bench.geometry import Box, LidarGeometry, Pose2D
from midnet_bench.grid import OccupancyGrid

MAP = "map"  # the frame of all poses
CUBE, TEXT = 1, 9  # visualization_msgs/Marker.type
DELETE_ALL = 3  # visualization_msgs/Marker.action
BOX_HEIGHT_M = 0.3
LABEL_M = 0.2  # height of a capital letter

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
    return Message(
        "geometry_msgs/msg/PoseStamped", {"header": header(MAP, stamp_ns), "pose": pose_fields(pose)}
    )


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
    twist = {"linear": {"x": linear_mps}, "angular": {"z": angular_radps}}
    return Message(
        "nav_msgs/msg/Odometry",
        {
            "header": header(frame, stamp_ns),
            "child_frame_id": child,
            "pose": {"pose": pose_fields(pose)},
            "twist": {"twist": twist},
        },
    )


def laser_scan(
    frame: str, stamp_ns: int, ranges_m: npt.NDArray[np.float64], lidar: LidarGeometry, period_s: float
) -> Message:
    """sensor_msgs/LaserScan with numbers of 32 bits; all beams of a scan leave at its stamp."""
    return Message(
        "sensor_msgs/msg/LaserScan",
        {
            "header": header(frame, stamp_ns),
            "angle_min": lidar.angle_min_rad,
            "angle_max": lidar.angle_min_rad + lidar.angle_increment_rad * (lidar.beams - 1),
            "angle_increment": lidar.angle_increment_rad,
            "scan_time": period_s,
            "range_min": lidar.range_min_m,
            "range_max": lidar.range_max_m,
            "ranges": ranges_m.astype(np.float32),
        },
    )


def exact_scan(ranges_m: npt.NDArray[np.float64], lidar: LidarGeometry) -> Message:
    """The same with 64 bits: angle_min, angle_increment, range_min, range_max, then the ranges."""
    said = (lidar.angle_min_rad, lidar.angle_increment_rad, lidar.range_min_m, lidar.range_max_m)
    return Message("std_msgs/msg/Float64MultiArray", {"data": np.concatenate((said, ranges_m))})


def occupancy_grid(stamp_ns: int, grid: OccupancyGrid) -> Message:
    """nav_msgs/OccupancyGrid of an int8 grid, map frame; row 0 is the lowest y there, too."""
    return Message(
        "nav_msgs/msg/OccupancyGrid",
        {
            "header": header(MAP, stamp_ns),
            "info": {
                "resolution": grid.resolution,
                "width": grid.width,
                "height": grid.height,
                "origin": pose_fields(Pose2D(*grid.origin, 0.0)),
            },
            "data": grid.data.reshape(-1),
        },
    )


def markers(stamp_ns: int, marked: Iterable[Marked]) -> Message:
    """visualization_msgs/MarkerArray: a cube for each box, in the place of all that the topic showed before.

    Ids count up within a space; a label is a text of the same space above its cube.
    """
    shown: list[Fields] = [{"header": header(MAP, stamp_ns), "action": DELETE_ALL}]
    used: dict[str, int] = {}
    for box, space, color, label in marked:
        x, y = box.center
        red, green, blue = (part / 255.0 for part in color)
        common = {"header": header(MAP, stamp_ns), "ns": space}
        cube = {
            "type": CUBE,
            "pose": {"position": {"x": x, "y": y, "z": BOX_HEIGHT_M / 2.0}},
            "scale": {"x": box.x_max - box.x_min, "y": box.y_max - box.y_min, "z": BOX_HEIGHT_M},
            "color": {"r": red, "g": green, "b": blue, "a": 0.6},
        }
        text = {
            "type": TEXT,
            "pose": {"position": {"x": x, "y": y, "z": BOX_HEIGHT_M + LABEL_M}},
            "scale": {"z": LABEL_M},
            "color": {"r": red, "g": green, "b": blue, "a": 1.0},
            "text": label,
        }
        for one in (cube, text) if label else (cube,):
            shown.append({**common, "id": used.get(space, 0), **one})
            used[space] = used.get(space, 0) + 1
    return Message("visualization_msgs/msg/MarkerArray", {"markers": shown})


def detections(stamp_ns: int, boxes: Sequence[Box], found_by: Sequence[str]) -> Message:
    """The team's boxes as markers, each in the space of the robot that found it."""
    return markers(
        stamp_ns, [Marked(box, name, DETECTION) for box, name in zip(boxes, found_by, strict=True)]
    )


def detections_2d(stamp_ns: int, boxes: Sequence[Box], ros: int) -> Message:
    """vision_msgs/Detection2DArray, map frame, metres instead of pixels; ``ros``: 1 or 2, which differ."""
    certain = {"score": 1.0}
    every = []
    for box in boxes:
        x, y = box.center
        at: Fields = {"x": x, "y": y}
        every.append(
            {
                "header": header(MAP, stamp_ns),
                "results": [certain if ros == 1 else {"hypothesis": {"class_id": "intruder", **certain}}],
                "bbox": {
                    "center": at if ros == 1 else {"position": at},
                    "size_x": box.x_max - box.x_min,
                    "size_y": box.y_max - box.y_min,
                },
            }
        )
    return Message("vision_msgs/msg/Detection2DArray", {"header": header(MAP, stamp_ns), "detections": every})


def text(said: object) -> Message:
    """std_msgs/String of what JSON can say."""
    return Message("std_msgs/msg/String", {"data": json.dumps(said)})
