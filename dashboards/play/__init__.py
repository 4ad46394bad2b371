"""Agents that act, as pictures that move."""
