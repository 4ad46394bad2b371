"""The learners of the agents, one module per algorithm."""
