"""From a search space to arms, and from arms to the cells of each stage."""
