"""What each robot is: its measures, its body, its LiDAR."""
