"""Recorded data in and out: bags, tables and logs into the detector, trials out as bags."""
