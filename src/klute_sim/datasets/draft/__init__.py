"""Draft of ``dataset.toml`` for a folder of bench recordings, from their headings and samples."""
