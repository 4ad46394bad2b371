"""Executors: a stage's cells by Ray Tune, in this process, or in processes beside it."""
