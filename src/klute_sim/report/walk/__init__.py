"""Reports of predicted walks: table, remarks and figure."""
