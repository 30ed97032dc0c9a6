"""An arena in which whoever goes from end to end passes the guards in the middle."""

import json


def corridor(length_m: float, intruders: int, clear_m: float) -> str:
    """It is 2 m wide; intruders start at least ``clear_m`` from the guards."""
    half_m = length_m / 2.0
    arena = {
        "name": "corridor",
        "plane_m": [length_m + 2.0, 4.0],
        "enclosure_m": [length_m, 2.0],
        "wall_thickness_m": 0.15,
        "wall_height_m": 1.0,
        "walls": [[[-half_m, -1], [half_m, -1], [half_m, 1], [-half_m, 1], [-half_m, -1]]],
        "robots": {"center_m": [0.0, 0.0], "spacing_m": 0.5},
        "mobile_intruders": {"count": intruders, "clear_of_robots_m": clear_m},
    }
    return json.dumps(arena)


SOON = {
    "arena": corridor(8.0, 2, 2.7),
    **{"prior_map": "exact", "escape_distance_m": 4.0, "engine": "fast"},
    **{"robots": 2, "intruders": 2, "capture": "detected", "time_limit_s": 4.0},
}
"""With seed 6 intruder 1 is caught after 3.4 s, and the other is still there at the end."""
