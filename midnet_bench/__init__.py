"""midnet-bench: how well does a team of LiDAR robots guard a building?

Importing this package loads nothing heavy; PyBullet is imported by ``midnet_bench.simulation`` alone.
"""

__version__ = "0.1.0"
