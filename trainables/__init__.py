"""What runs on a worker: tasks, agents, delta, and the training of one cell."""
