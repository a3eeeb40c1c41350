"""All rows of the table, one line for each module of effects."""

from benchmarks.effect_sizes import air, damper, friction, muscle_shape

ROWS = (*friction.ROWS, *muscle_shape.ROWS, *damper.ROWS, *air.ROWS)
"""Sizes of all effects that the table covers."""
