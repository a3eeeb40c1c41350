"""Refusing what cannot be sized, in one sentence."""

from klute_sim.errors import InputError


def check_range(name: str, value: float, low: float, high: float, unit: str, si_factor: float = 1.0) -> None:
    """Raise InputError unless ``value`` [SI] is between ``low`` and ``high``, both in ``unit`` of ``factor`` SI."""
    shown = value / si_factor
    # A hair's width: 0.48 m is 480.00000000000006 mm. Not a number is never inside.
    if not low * (1.0 - 1e-12) <= shown <= high * (1.0 + 1e-12):
        raise InputError(f"{name} is {shown:g}; allowed: {low:g} to {high:g} {unit}".rstrip())
