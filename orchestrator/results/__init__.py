"""The results of sweeps on disk: records, tables, lock and log."""
