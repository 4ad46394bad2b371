"""The commands of `deltatune`."""
