"""MLflow and other trackers."""
