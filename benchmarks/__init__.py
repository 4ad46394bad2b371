"""Speed measurements against public peers and anchors of results, run by hand."""
