"""Everything that touches a file: atomic writes, checked YAML, maps, scan logs, trajectories."""
