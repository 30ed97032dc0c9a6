"""Arenas, TurtleBot3 Burgers and their sensors in one of two engines."""
