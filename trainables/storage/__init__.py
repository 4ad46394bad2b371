"""Paths, files, folders and checkpoints."""
