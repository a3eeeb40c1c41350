"""The sections of a device file: their keys, units, limits and SI parameters.

``section`` is the base; ``supply`` and ``effects`` hold their sections; ``document`` holds the file as a whole.
"""
