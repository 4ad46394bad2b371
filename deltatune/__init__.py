"""The face of deltatune: the command line, and what a sweep writes at its end."""
