"""The earlier name of `trainables.custom`, for files that import from here."""

from trainables.custom import agent, feature, load, tabular_task, task

__all__ = ["agent", "feature", "load", "tabular_task", "task"]
