"""The tables of a sweep: rows from records, and their files."""
