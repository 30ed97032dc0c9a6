"""Who simulates, by name; nothing is imported before it is asked for."""

from midnet_bench.seams import Seam

SIMULATORS = Seam(
    option="engine",
    entry_points="midnet_bench.simulators",
    method="step",
    own={"bullet": None, "fast": None},
)
"""see ``simulation/own_engine.py``"""
