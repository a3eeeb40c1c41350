"""Report of a gait run: table and figure."""
