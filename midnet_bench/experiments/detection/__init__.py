"""The detection test of section V.A."""
