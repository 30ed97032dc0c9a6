"""Files of recordings, read and written."""
