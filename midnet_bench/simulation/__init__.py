"""Arenas, TurtleBot3 Burgers and their sensors in PyBullet."""
