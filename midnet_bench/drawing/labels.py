"""Axis labels: words with units instead of the names of columns and parameters."""

LONGEST = 44
"""characters of an explanation that fits an axis"""
NAMES = {
    "f1": "F1",
    "f1_one_to_one": "F1, one-to-one",
    "gospa_per_frame_m": "GOSPA, m per frame",
    "robots": "security robots",
    "intruders": "intruders",
    "frames": "frames",
    "caught_percent": "intruders caught, %",
    "success_rate": "success rate, %",
    "local_size_m": "local costmap's side, m",
    "obstacle_range_m": "usable LiDAR range, m",
    "thresh_local": "thresh of Eq. 1, local costmap",
    "thresh_global": "thresh of Eq. 1, prior map",
    "resolution_m": "side of a cell, m",
    "iou_fuse": "least IoU of fused boxes",
    "iou_ally": "least IoU with an ally's square",
    "message_delay_s": "delay of messages, s",
    "message_loss": "share of messages lost",
    "lidar_dropout": "share of beams without return",
    "intruder_speed_mps": "intruders' top speed, m/s",
}
UNITS = {
    "_mps2": "m/s²",
    "_radps": "rad/s",
    "_percent": "%",
    "_mps": "m/s",
    "_deg": "degrees",
    "_rad": "rad",
    "_hz": "Hz",
    "_m": "m",
    "_s": "s",
}
"""end of a name -> its unit"""


def axis_label(name: str, explanation: str = "") -> str:
    """What an axis says of a column or a parameter.

    Args:
        name: such as ``message_delay_s``.
        explanation: its help; the first clause, where it is short, stands for a name that is not known here.
    """
    if name in NAMES:
        return NAMES[name]
    end = next((one for one in UNITS if name.endswith(one)), "")
    clause = explanation.split(".")[0].split(",")[0].split(";")[0].split(":")[0].split("(")[0].strip()
    words = name.removesuffix(end).replace("_", " ")
    if 0 < len(clause) <= LONGEST:
        is_word = clause.split()[0][1:].islower()  # and no abbreviation
        words = clause[0].lower() + clause[1:] if is_word else clause
    return f"{words}, {UNITS[end]}" if end else words
