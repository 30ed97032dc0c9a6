"""Map construction of section II.A."""
