"""``make bench``: every benchmark in turn."""

import runpy

for name in ("trial", "physics", "navigation", "gmapping", "store"):
    print(f"== {name}")
    runpy.run_module(f"benchmarks.{name}", run_name="__main__")
