"""Executors: they run a stage's cells with Ray Tune, in this process, or in a pool of processes."""
