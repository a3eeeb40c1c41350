"""Numbers of a model that a dataset changes: lengths and masses that do not belong to the model in its file."""

from collections.abc import Mapping
from typing import NamedTuple

from klute_sim.plausibility.finding import Finding
from klute_sim.plausibility.units import round_digits

GEOMETRY_NAME = "length-geometry"
"""Name of a finding about the path of a tendon."""
MAX_LENGTH_RATIO = 10.0
"""Largest ratio of a size or coordinate to the size of the model (assumed; mm for m is a factor of 1000)."""
MAX_MASS_RATIO = 100.0
"""Largest ratio of a mass to that of all bodies of the model (assumed; g for kg is a factor of 1000)."""
MAX_REACH = 2.0
"""Largest ratio of the path of a tendon to the resting length of its device, or of that length to the path, at every
position of the joints (assumed: muscles shorten by a third and hardly stretch)."""


class ModelSize(NamedTuple):
    """Size of the model as its file states it."""

    extent: float
    """Size [m]."""
    mass: float
    """Mass of all bodies [kg]."""


def check_model_sizes(numbers: Mapping[str, float], size: ModelSize, place: str) -> list[Finding]:
    """Return a finding for each of the changed ``numbers`` (name -> value) that is far too large for the model."""
    findings = []
    for name, value in numbers.items():
        number = name.rpartition(".")[2]
        is_length = number.startswith(("pos_", "ipos_", "size_"))
        limit = MAX_LENGTH_RATIO * size.extent if is_length else MAX_MASS_RATIO * size.mass
        if not (is_length or number == "mass") or limit <= 0.0 or abs(value) <= limit:
            continue
        unit, smaller = ("m", "mm") if is_length else ("kg", "g")
        subject = "the model has a size of" if is_length else "all bodies of the model together have"
        amount = size.extent if is_length else size.mass
        fits = abs(value) / 1000.0 <= limit
        cause = f"is it in {smaller}? Write {round_digits(value / 1000.0):g}" if fits else "correct it"
        statement = (
            f"{name} is {round_digits(value):g} {unit}, but {subject} {round_digits(amount):g} {unit}; allowed: up to "
            f"{round_digits(limit):g} {unit} (assumed); {cause}"
        )
        findings.append(Finding(name, place, statement))
    return findings


def check_reach(tendon: str, path: tuple[float, float], unit_length: float, place: str) -> list[Finding]:
    """Return a finding if the device on ``tendon`` cannot reach along its path, or never gets taut.

    ``path`` holds the shortest and the longest path of the tendon [m] between the stops of the joints, and
    ``unit_length`` the length of the device [m] at rest.
    """
    if path[0] <= MAX_REACH * unit_length and path[1] >= unit_length / MAX_REACH:
        return []
    effect = "the device cannot reach" if path[0] > unit_length else "the device never gets taut"
    first, last, length = (f"{round_digits(1000.0 * value):g} mm" for value in (*path, unit_length))
    statement = (
        f"the path of tendon '{tendon}' in the model is {first} to {last} long, but its device, muscle and tendon, is "
        f"{length} long at rest, so {effect}; correct the sites of the tendon in the model or in [numbers], or the "
        "lengths of the device"
    )
    return [Finding(GEOMETRY_NAME, place, statement)]
