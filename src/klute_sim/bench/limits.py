"""Limits of bench tests: unit lengths for muscle lengths, available pressures and reachable speeds."""

from collections.abc import Iterable

from klute_sim.device.device import Device, check_accepts_pressure, check_is_testable
from klute_sim.device.dynamics import compute_muscle_force, compute_tendon_force
from klute_sim.device.equilibrium import compute_taut_state
from klute_sim.errors import InputError
from klute_sim.laws.mckibben import lock_length
from klute_sim.units import BAR

MAX_TENDON_STRETCH = 10.0
"""Upper bound [m] of the search for a tendon's stretch; real tendons stretch far less."""


def isometric_force(device: Device, muscle_ratio: float, pressure: float) -> float:
    """Return the steady muscle force [N] at ``muscle_ratio`` of the resting length under ``pressure`` [Pa].

    A unit with a tendon delivers a positive force only; a bare muscle pushes where the force is negative.
    """
    parameters = device.parameters
    length = muscle_ratio * parameters.muscle.resting_length
    state = compute_taut_state(parameters, parameters.tendon.slack_length + length, pressure).internal_state
    return compute_muscle_force(parameters, state, pressure, length, 0.0)


def unit_length(device: Device, muscle_ratio: float, pressure: float) -> float:
    """Return the unit length [m] at which the muscle rests at ``muscle_ratio`` under ``pressure`` [Pa].

    ``muscle_ratio`` is the muscle length over its resting length, or the length of a cylinder over its extended length.
    At zero pressure the tendon is just taut.

    Raises InputError when the muscle cannot have this length.
    """
    check_is_testable(device)
    parameters = device.parameters
    muscle = parameters.muscle
    if muscle.resting_length == 0.0:
        raise InputError(
            f"the protocol sets lengths as parts of a muscle or a cylinder, but '{device.name}' has neither; allowed: "
            "a protocol with unit_lengths_mm, such as isokinetic-unit"
        )
    min_ratio = lock_length(muscle) / muscle.resting_length
    if not min_ratio <= muscle_ratio <= 1.0:
        raise InputError(
            f"a muscle_ratio is {muscle_ratio:g}; allowed for '{device.name}': {min_ratio:.3f} to 1 "
            "(lock length to resting length)"
        )
    length, slack = muscle_ratio * muscle.resting_length, parameters.tendon.slack_length
    force = isometric_force(device, muscle_ratio, pressure)
    if parameters.tendon.is_rigid or force <= 0.0:
        return slack + length
    state = compute_taut_state(parameters, slack + length, pressure).internal_state
    lower, upper = 0.0, MAX_TENDON_STRETCH
    for _ in range(60):
        middle = 0.5 * (lower + upper)
        is_below = compute_tendon_force(parameters, state, length, slack + length + middle) < force
        lower, upper = (middle, upper) if is_below else (lower, middle)
    return slack + length + upper


def check_supply_pressure(device: Device, pressures_bar: Iterable[float]) -> None:
    """Raise InputError unless a tester can pull ``device``, and its supply reaches all ``pressures_bar`` on command."""
    check_is_testable(device)
    check_accepts_pressure(device, "the protocol")
    if device.spec.supply is None and any(pressures_bar):
        raise InputError(
            f"the protocol sets pressures, but '{device.name}' has no [supply]; allowed: pressures_bar = [0]"
        )
    max_bar = device.parameters.supply.max_pressure / BAR
    for pressure in pressures_bar:
        if pressure > max_bar:
            raise InputError(
                f"the protocol needs {pressure:g} bar, but the supply of '{device.name}' has {max_bar:g} bar; "
                "lower the pressures of the protocol"
            )


def check_reachable_speed(speed: float, distance: float, acceleration: float) -> None:
    """Raise InputError unless ``speed`` [m/s] is reached within ``distance`` [m] at ``acceleration`` [m/s^2]."""
    max_speed = (distance * acceleration) ** 0.5
    if speed >= max_speed:
        raise InputError(
            f"a velocity is {1e3 * speed:g} mm/s, but over {1e3 * distance:.3g} mm at {acceleration:g} m/s2 the "
            f"crosshead reaches less than {1e3 * max_speed:.4g} mm/s; make the stroke longer or the velocity lower"
        )
