"""From scans to a prior map: GMapping, frontier exploration, merging and scoring of maps."""
