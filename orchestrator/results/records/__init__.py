"""The records of cells, and their log on disk."""
