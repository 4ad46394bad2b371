"""Benchmarks: speed compared with public peers and limits, the cost of sweeps and tracking, and studies of results."""
