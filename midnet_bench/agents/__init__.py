"""What runs on one robot: a guard or an intruder, on the stack of its own sensors."""
