"""The built-in tasks, one module per environment."""
