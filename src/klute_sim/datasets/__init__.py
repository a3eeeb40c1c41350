"""Measured datasets: a folder of trials with a file that says what they are.

Floors inside the package, each using only those above it: ``quantity`` (units), ``channels`` (what each rig has),
``text`` and ``table`` (one file), ``trial``, ``format`` (``dataset.toml``), ``override``, ``split``, ``dataset``;
``write`` stands alone.
"""
