"""The built-in agents, one module for each or for a family of them."""
