"""The labyrinth test of section V.B."""
