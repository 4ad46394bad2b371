"""Who runs it: plans, sweeps, results, statistics, tracking and the command line."""
