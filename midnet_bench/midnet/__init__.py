"""MIDNet: ``detection`` is IV.A and IV.B of the paper, ``fusion`` IV.C; ``pipeline`` runs section IV."""
