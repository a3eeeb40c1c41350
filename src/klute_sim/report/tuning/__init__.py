"""Report of a tuning: figures."""
