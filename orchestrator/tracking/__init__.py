"""Trackers: copies of a sweep's results in MLflow and elsewhere."""
