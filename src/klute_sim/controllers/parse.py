"""Create a controller from a string such as ``off``, ``constant:3.5``, ``profile``, ``mine.csv``."""

from collections.abc import Callable
from pathlib import Path

from klute_sim.controllers import learned, pressure, state_machine
from klute_sim.controllers.feedback import FeedbackController
from klute_sim.controllers.pressure import PressureController
from klute_sim.errors import InputError
from klute_sim.units import BAR

Controller = PressureController | FeedbackController

CONTROLLER_SYNTAX = (
    "profile, off, constant:BAR, machine, or a file: a profile (.csv), a state machine (.toml), a trained policy (.npz)"
)
"""Allowed strings, for help and errors."""


def parse_controller(spec: str) -> Controller:
    """Return the controller that ``spec`` describes: a kind with an optional argument after a colon, or a file.

    Raises InputError when ``spec`` is not a controller.
    """
    if spec in ("", "."):  # a shell variable that is not set
        raise InputError(f"the name of the controller is empty; allowed: {CONTROLLER_SYNTAX}")
    kind, _, argument = spec.partition(":")
    if kind in CONTROLLER_FACTORIES:
        return CONTROLLER_FACTORIES[kind](argument)
    if not spec or not (Path(spec).suffix or Path(spec).exists()):
        raise InputError(f"no controller '{spec}'; allowed: {CONTROLLER_SYNTAX}")
    return LOADER_OF_SUFFIX.get(Path(spec).suffix.lower(), pressure.load_profile)(spec)


def _create_off(argument: str) -> Controller:
    if argument:
        raise InputError(f"controller 'off:{argument}': off has no argument")
    return pressure.create_off_controller()


def _parse_constant(argument: str) -> Controller:
    try:
        gauge_pressure = float(argument)
    except ValueError:
        raise InputError(f"controller 'constant:{argument}' needs a pressure in bar, as in constant:3.5") from None
    return pressure.ConstantPressure(gauge_pressure * BAR)


def _load_profile(argument: str) -> Controller:
    return pressure.load_profile(argument) if argument else pressure.load_default_profile()


def _load_state_machine(argument: str) -> Controller:
    return state_machine.load_state_machine(argument) if argument else state_machine.load_default_state_machine()


CONTROLLER_FACTORIES: dict[str, Callable[[str], Controller]] = {
    "profile": _load_profile,
    "off": _create_off,
    "constant": _parse_constant,
    "machine": _load_state_machine,
}
"""Kind -> function that creates a controller from the text after the colon, which may be empty."""

LOADER_OF_SUFFIX: dict[str, Callable[[str], Controller]] = {
    ".toml": state_machine.load_state_machine,
    ".npz": learned.load_policy_controller,
}
"""Suffix of a file -> function that loads a controller; files with other suffixes are profiles."""
