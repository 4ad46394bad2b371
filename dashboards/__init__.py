"""The figures of a sweep, their renderers, the report, and films of episodes."""
