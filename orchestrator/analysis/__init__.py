"""Statistics over seeds, selection of configurations, and comparisons."""
