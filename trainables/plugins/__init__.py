"""Tasks and agents that a user brings: named, loaded, sent to workers, and remembered."""
