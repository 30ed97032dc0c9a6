"""MIDNet, section IV of the paper: costmaps and poses of a team in, boxes around intruders out.

``binary_map`` is section IV.A, ``cropping`` B.1, ``foreground`` B.2 to B.4, ``fusion`` C; ``pipeline`` runs
them in this order.
"""
