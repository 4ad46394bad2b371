"""Paths, files and checkpoints."""
