"""Bounded reading of every file that a user can give.

``reading`` opens a regular file within a size limit; ``toml``, ``json``, ``npz``, ``parquet``, ``mat`` and ``lines``
decode its content, and check nesting, numbers and memory before a parser sees it. ``limits`` holds all limits.
``isolation`` runs a library that damaged files can crash in a process of its own.
"""
