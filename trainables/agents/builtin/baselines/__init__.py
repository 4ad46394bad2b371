"""Deep agents to compare the paper's with, a file each: what the literature does with a source, and ablations."""
