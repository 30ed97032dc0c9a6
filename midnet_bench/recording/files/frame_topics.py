"""What a detector made of a frame, as topics of a bag: of trials and of recordings alike."""

from collections.abc import Sequence

import numpy as np

from midnet_bench.drawing.palette import FAINT_INK, GUARD_FAINT
from midnet_bench.grid import OCCUPIED, OccupancyGrid
from midnet_bench.midnet.pipeline import Frame
from midnet_bench.recording.files import ros_messages as ros
from midnet_bench.recording.files.ros_messages import Marked
from midnet_bench.recording.files.writer import BagWriter


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
