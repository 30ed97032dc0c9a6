"""Where a robot believes it is."""
