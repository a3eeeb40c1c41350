"""One type for everything that was recorded or measured, and its readers and writers."""
