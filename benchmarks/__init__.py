"""Speed measurements against public peers, run by hand."""
