"""Where a device can be tested: unit lengths for muscle lengths, and pressures its supply has."""

from collections.abc import Iterable

from klute_sim.device.device import Device, check_takes_pressure
from klute_sim.device.dynamics import compute_muscle_damper_force, compute_taut_state, compute_tendon_force
from klute_sim.errors import InputError
from klute_sim.laws.mckibben import lock_length
from klute_sim.units import BAR

MAX_TENDON_STRETCH = 10.0
"""Of a tendon [m]; no device comes near."""


def isometric_force(device: Device, muscle_ratio: float, pressure: float) -> float:
    """What the muscle pulls with [N], held at ``ratio`` of its resting length under ``pressure`` [Pa] for long.

    A unit with a tendon delivers it where it is positive; a bare muscle pushes where it is negative.
    """
    parameters = device.parameters
    length = muscle_ratio * parameters.muscle.resting_length
    rested = compute_taut_state(parameters, parameters.tendon.slack_length + length, pressure).internal_state
    return compute_muscle_damper_force(parameters, rested, pressure, length, 0.0)


def unit_length(device: Device, muscle_ratio: float, pressure: float) -> float:
    """Unit length [m] at which the muscle rests at ``ratio`` of its resting length under ``pressure`` [Pa].

    At zero pressure the tendon is just taut. Raises InputError for a ratio that the muscle cannot have.
    """
    parameters = device.parameters
    muscle = parameters.muscle
    shortest = lock_length(muscle) / muscle.resting_length
    if not shortest <= muscle_ratio <= 1.0:
        raise InputError(
            f"a muscle_ratio is {muscle_ratio:g}; allowed for '{device.name}': {shortest:.3f} to 1 (lock length to resting "
            "length)"
        )
    length, slack = muscle_ratio * muscle.resting_length, parameters.tendon.slack_length
    pull = isometric_force(device, muscle_ratio, pressure)
    if parameters.tendon.is_rigid or pull <= 0.0:
        return slack + length
    rested = compute_taut_state(parameters, slack + length, pressure).internal_state
    low, high = 0.0, MAX_TENDON_STRETCH
    for _ in range(60):
        middle = 0.5 * (low + high)
        below = compute_tendon_force(parameters, rested, length, slack + length + middle) < pull
        low, high = (middle, high) if below else (low, middle)
    return slack + length + high


def check_supply_pressure(device: Device, pressures_bar: Iterable[float]) -> None:
    """Raise InputError unless the device's supply takes pressures, and has every one of ``pressures_bar``."""
    check_takes_pressure(device, "the protocol")
    most = device.parameters.supply.max_pressure / BAR
    for pressure in pressures_bar:
        if pressure > most:
            raise InputError(f"the protocol asks for {pressure:g} bar; the supply of '{device.name}' has {most:g} bar")


def check_reachable_speed(speed: float, distance: float, acceleration: float) -> None:
    """Raise InputError unless ``speed`` [m/s] is reached within ``way`` [m] at ``acceleration`` [m/s^2]."""
    most = (distance * acceleration) ** 0.5
    if speed >= most:
        raise InputError(
            f"a velocity is {1e3 * speed:g} mm/s, but over {1e3 * distance:.3g} mm at {acceleration:g} m/s2 the crosshead "
            f"reaches less than {1e3 * most:.4g} mm/s; make the stroke longer or the velocity lower"
        )
