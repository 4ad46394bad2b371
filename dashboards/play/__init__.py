"""Films of agents acting."""
