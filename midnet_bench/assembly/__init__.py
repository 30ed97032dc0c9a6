"""From a map, poses and scans to the team's boxes: what a robot, a trial and a recording share."""
