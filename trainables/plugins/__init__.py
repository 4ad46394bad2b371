"""Custom tasks and agents: their names, loading, shipping to workers, and notes."""
