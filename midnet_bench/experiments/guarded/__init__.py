"""What the experiments with guards share: the arena in motion, MIDNet over it, their parameters."""
