"""How well the team did: counts against the truth, ratios of them, and how sure one can be."""
