"""What to run, where it runs, and the store that keeps every finished trial."""
