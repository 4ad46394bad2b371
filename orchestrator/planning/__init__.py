"""From a search space to arms and cells."""
