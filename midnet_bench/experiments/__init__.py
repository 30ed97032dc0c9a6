"""The trial functions: one trial is a pure function of its parameters and its seed."""
