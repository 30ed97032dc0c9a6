"""What stands in a recording's files, read and written."""
