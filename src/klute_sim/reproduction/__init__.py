"""The dissertation, item by item: what it prints, what we compute, and a verdict."""
