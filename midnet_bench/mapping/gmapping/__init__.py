"""GMapping: a grid map and a trajectory from scans and odometry, by particles."""
