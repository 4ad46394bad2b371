"""Records, tables, lock: the truth on disk."""
