"""What runs on one robot, a guard, an intruder or an explorer, by its own sensors alone: no simulator here."""
