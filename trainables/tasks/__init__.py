"""The tasks: environments with context features."""
