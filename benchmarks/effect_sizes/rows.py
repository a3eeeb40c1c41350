"""All rows of the table, one line for each module of effects."""

from benchmarks.effect_sizes import damper, friction, muscle_shape

ROWS = (*friction.ROWS, *muscle_shape.ROWS, *damper.ROWS)
"""Sizes of all effects that the table covers."""
