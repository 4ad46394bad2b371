"""Results of sweeps as a dataset that others can read with any Parquet reader, and replay row by row."""
