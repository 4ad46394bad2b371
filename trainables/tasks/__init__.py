"""Tasks: environments with context features."""
