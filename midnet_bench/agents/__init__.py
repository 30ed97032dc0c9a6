"""What runs on one robot, a guard, an intruder or an explorer, on its own sensors; and the fleet of them."""
