"""How agents learn, one file per algorithm."""
