"""Published datasets: results of sweeps that any Parquet reader opens, and that can be replayed row by row."""
