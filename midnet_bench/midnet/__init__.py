"""MIDNet, section IV of the paper: costmaps and poses of a team in, boxes around intruders out.

One file per subsection: ``binary_map`` (A), ``cropping`` (B.1), ``subtraction`` (B.2), ``boxes`` (B.3,
B.4), ``allies`` (C.1), ``fusion`` (C.2); ``pipeline`` runs them in this order.
"""
