"""All rows of the table, one line for each module of effects."""

from benchmarks.effect_sizes import damper, friction

ROWS = (*friction.ROWS, *damper.ROWS)
"""Sizes of all effects that the table covers."""
