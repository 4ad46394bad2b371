"""Ray clusters: joining one, its nodes, and jobs."""
