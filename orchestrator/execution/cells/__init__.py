"""The cells of a running sweep: which are planned, which have ended, and which run next, from where."""
