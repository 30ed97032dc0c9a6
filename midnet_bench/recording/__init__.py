"""Recordings of robots and of trials: what MIDNet makes of them, and whether their parts fit together."""
