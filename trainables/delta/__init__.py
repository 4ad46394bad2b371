"""delta: the distance between the dynamics of a target task and a source task (paper, "Delta Function")."""
