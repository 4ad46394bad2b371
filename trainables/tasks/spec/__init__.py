"""The data classes of tasks."""
