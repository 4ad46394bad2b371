"""One agent of a sweep against another, and all comparisons of a sweep together."""
