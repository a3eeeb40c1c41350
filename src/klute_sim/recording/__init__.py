"""Recordings, simulated or measured, and their files.

``recording`` is the type; ``parquet`` writes and reads it, and ``csv`` writes it; ``run_folder`` creates the folders of
runs.
"""
