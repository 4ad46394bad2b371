"""Ranking of sources for a target."""
