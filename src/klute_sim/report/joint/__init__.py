"""Report of a test of a joint or a free load: table, CSV and figure."""
