"""Many walks: every combination of what was listed, on all cores or on a cluster, as one table."""
