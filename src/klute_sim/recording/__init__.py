"""Recordings, simulated or measured, and their files.

``recording`` is the type; ``parquet`` and ``csv`` write and read it; ``run_folder`` creates the folders of runs.
"""
