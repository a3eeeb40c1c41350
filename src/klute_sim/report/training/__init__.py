"""Report of a training: figure."""
