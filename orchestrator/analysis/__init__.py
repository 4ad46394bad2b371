"""Statistics over seeds, selection, and what a sweep found."""
