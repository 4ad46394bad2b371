"""Ray: joining a cluster, its nodes, and jobs."""
