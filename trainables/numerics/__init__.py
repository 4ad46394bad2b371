"""Compiled kernels, random streams, threads."""
