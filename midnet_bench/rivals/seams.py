"""Detectors, fusions, patrols and pursuits by name; imported on demand."""

from midnet_bench.seams import ExtensionPoint

DETECTORS = ExtensionPoint(
    option="detector",
    entry_points="midnet_bench.detectors",
    method="detect",
    own={
        "midnet": None,
        "subtraction": "midnet_bench.rivals.map_subtraction:MapSubtraction",
        "clusters": "midnet_bench.rivals.clusters:CircleClusters",
        "background": "midnet_bench.rivals.background:RunningMean",
    },
)
"""see ``rivals/detector.py``"""

FUSIONS = ExtensionPoint(
    option="fusion",
    entry_points="midnet_bench.fusions",
    method="fuse",
    own={
        "paper": None,
        "none": "midnet_bench.rivals.plain_fusions:NoFusion",
        "suppression": "midnet_bench.rivals.plain_fusions:NonMaximumSuppression",
        "components": "midnet_bench.rivals.plain_fusions:ConnectedComponents",
        "weighted": "midnet_bench.rivals.weighted_boxes:WeightedBoxes",
        "centres": "midnet_bench.rivals.centre_distance:CentreDistance",
        "tracks": "midnet_bench.rivals.kalman_tracks:KalmanTracks",
    },
)
"""see ``rivals/fusion.py``"""

PATROLS = ExtensionPoint(
    option="patrol",
    entry_points="midnet_bench.patrols",
    method="next_point",
    own={
        "paper": None,
        "cyclic": "midnet_bench.rivals.patrols:CyclicRoute",
        "reactive": "midnet_bench.rivals.patrols:ConscientiousReactive",
        "coordinated": "midnet_bench.rivals.patrols:CoordinatedIdleness",
    },
)
"""see ``rivals/patrol.py``"""

PURSUITS = ExtensionPoint(
    option="pursuit",
    entry_points="midnet_bench.pursuits",
    method="pursue",
    own={
        "nearest": "midnet_bench.rivals.pursuits:Nearest",
        "all": "midnet_bench.rivals.pursuits:All",
        "assignment": "midnet_bench.rivals.pursuits:Assignment",
        "none": "midnet_bench.rivals.pursuits:Nobody",
        "oracle": None,
    },
)
"""see ``agents/pursuit.py``"""
