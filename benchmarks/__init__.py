"""Measurements run by hand: speed against public peers, results against the figures of the specification."""
