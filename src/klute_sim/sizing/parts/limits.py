"""Range checks of design inputs."""

from klute_sim.errors import InputError


def check_range(name: str, value: float, low: float, high: float, unit: str, si_factor: float = 1.0) -> None:
    """Raise InputError unless ``value`` [SI] is between ``low`` and ``high`` in ``unit``, which equals ``si_factor``
    SI units.
    """
    value_in_unit = value / si_factor
    # Tolerance of rounding: 0.48 m is 480.00000000000006 mm. NaN is never inside.
    if not low * (1.0 - 1e-12) <= value_in_unit <= high * (1.0 + 1e-12):
        raise InputError(f"{name} is {value_in_unit:g}; allowed: {low:g} to {high:g} {unit}".rstrip())
