"""Physical constants that more than one package uses."""

GRAVITY = 9.81
"""Standard acceleration of free fall as the dissertation rounds it [m/s^2]."""
DEGREES_PER_RADIAN = 57.29577951308232
"""Factor that converts radians into degrees."""
