"""The tables of a sweep's configurations, and the paper's own."""
