"""Everything that runs on a worker: tasks, agents, delta, and the training of a cell."""
