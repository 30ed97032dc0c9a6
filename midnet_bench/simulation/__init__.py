"""Arenas, TurtleBot3 Burgers and their sensors in one of several engines."""
