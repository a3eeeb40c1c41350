"""Report of a bench run: table, CSV and figure."""
