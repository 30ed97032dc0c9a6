"""Detectors and fusions by name; imported on demand."""

from midnet_bench.seams import ExtensionPoint

DETECTORS = ExtensionPoint(
    option="detector",
    entry_points="midnet_bench.detectors",
    method="detect",
    own={
        "midnet": None,
        "subtraction": "midnet_bench.detectors.map_subtraction:MapSubtraction",
        "clusters": "midnet_bench.detectors.clusters:CircleClusters",
        "background": "midnet_bench.detectors.background:RunningMean",
    },
)
"""see ``detectors/detector.py``"""

FUSIONS = ExtensionPoint(
    option="fusion",
    entry_points="midnet_bench.fusions",
    method="fuse",
    own={
        "paper": None,
        "none": "midnet_bench.detectors.plain_fusions:NoFusion",
        "suppression": "midnet_bench.detectors.plain_fusions:NonMaximumSuppression",
        "components": "midnet_bench.detectors.plain_fusions:ConnectedComponents",
        "weighted": "midnet_bench.detectors.weighted_boxes:WeightedBoxes",
        "centres": "midnet_bench.detectors.centre_distance:CentreDistance",
        "tracks": "midnet_bench.detectors.kalman_tracks:KalmanTracks",
    },
)
"""see ``detectors/fusion.py``"""
