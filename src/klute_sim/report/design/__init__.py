"""Report of a design: tables and figure."""
