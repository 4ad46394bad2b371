"""A sweep's session: stages, work queue, executors, early stopping, display."""
