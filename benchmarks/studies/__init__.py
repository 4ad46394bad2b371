"""Studies on results of sweeps, and anchors that they must meet."""
