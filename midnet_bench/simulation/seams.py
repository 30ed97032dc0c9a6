"""Engines by name; imported on demand."""

from midnet_bench.seams import ExtensionPoint

SIMULATORS = ExtensionPoint(
    option="engine",
    entry_points="midnet_bench.simulators",
    method="step",
    own={"bullet": None, "fast": None, "mujoco": "midnet_bench.simulation.mujoco_world:World"},
    needs={"mujoco": "mujoco"},
)
"""see ``simulation/own_engine.py``"""
