"""The source library."""
