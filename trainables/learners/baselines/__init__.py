"""Other uses of a source in a deep agent, as baselines for comparison, one module each."""
