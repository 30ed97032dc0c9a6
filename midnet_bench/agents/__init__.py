"""What runs on one robot, guard, intruder or explorer, by its own sensors alone; it knows no simulator."""
