"""The commands of `deltatune`, by subject."""
