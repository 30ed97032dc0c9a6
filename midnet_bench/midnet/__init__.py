"""MIDNet, section IV of the paper: costmaps and poses of a team in, boxes around intruders out.

``detection`` has subsections A and B, ``fusion`` has C; ``pipeline`` runs them.
"""
