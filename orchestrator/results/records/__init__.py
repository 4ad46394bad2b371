"""The records of cells, and their log: the truth on disk."""
