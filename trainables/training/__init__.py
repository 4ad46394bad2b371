"""Training of cells: train(cell, source), and Ray Tune trainables around it."""
