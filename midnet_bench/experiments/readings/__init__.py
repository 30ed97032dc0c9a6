"""What each reading of the paper's gaps moves."""
