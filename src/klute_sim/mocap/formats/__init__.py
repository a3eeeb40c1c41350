"""Files of motion laboratories: readers and writers that know the format and nothing of what is in it."""
