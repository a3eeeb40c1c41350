"""MJCF files that may come from a user: read and checked (``model_file``), and their numbers (``model_numbers``)."""
