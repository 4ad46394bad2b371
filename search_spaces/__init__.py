"""Search spaces: what to sweep, as plain data, each number with its source in the paper."""
