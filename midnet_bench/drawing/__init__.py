"""Figures, scenes and films, from plain data."""
