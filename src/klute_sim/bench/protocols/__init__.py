"""The kinds of tests that a protocol file can ask for, one per file."""
