"""Which source to take."""
