"""Whether scans, poses and a map fit, and what corrects them."""
