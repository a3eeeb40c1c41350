"""Physical constants that more than one package uses."""

GRAVITY = 9.81
"""Standard acceleration of free fall as the dissertation rounds it [m/s^2]."""
