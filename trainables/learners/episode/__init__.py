"""Whole episodes of the deep agents, compiled."""
