"""Deep baselines, one module each: other uses of a source from the literature, and ablations."""
