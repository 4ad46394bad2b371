"""delta: how far a target task's dynamics are from a source task's (paper, "Delta Function")."""
