"""How long a trial takes before any was measured: what ``--dry-run`` and the first estimate go by."""

START_S = 1.0
"""to import the simulator and to place everything"""
SECONDS_PER_SIMULATED_SECOND = {"fast": (0.013, 0.003), "bullet": (0.030, 0.006), "mujoco": (0.024, 0.005)}
"""engine -> (of the world, of each robot of the team): CPU seconds of one core for a simulated second.

Measured with compiled loops on a virtual AMD EPYC: detection with 300 frames and labyrinth with 40 s, one and
five robots, with the causes of errors counted; ``mujoco`` without them.
"""


def trial_wall_s(engine: str, robots: int, simulated_s: float) -> float:
    """About how long a trial takes on one core, seconds; an engine of your own counts as ``bullet``."""
    world, robot = SECONDS_PER_SIMULATED_SECOND.get(engine, SECONDS_PER_SIMULATED_SECOND["bullet"])
    return START_S + simulated_s * (world + robot * robots)
