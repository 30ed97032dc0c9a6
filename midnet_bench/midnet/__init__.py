"""MIDNet, section IV of the paper: costmaps and poses of a team in, boxes around intruders out.

One file per subsection: ``binary_map`` (A), ``detection`` (B), ``fusion`` (C); ``pipeline`` runs them.
"""
