"""Training a cell: train(cell, source), and the shell of Ray Tune around it."""
