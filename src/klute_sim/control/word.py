"""A controller in one word, as it is typed: ``off``, ``constant:3.5``, ``profile``, ``mine.csv``."""

from collections.abc import Callable
from pathlib import Path

from klute_sim.control import learned, machine
from klute_sim.control import pressure as control
from klute_sim.control.feedback import FeedbackController
from klute_sim.control.pressure import PressureController
from klute_sim.errors import InputError
from klute_sim.units import BAR

Controller = PressureController | FeedbackController
WORDS = (
    "profile, off, constant:BAR, machine, or a file: a profile (.csv), a state machine (.toml), a trained policy (.npz)"
)
"""What can be typed, for help and errors."""


def parse(word: str) -> Controller:
    """The controller that ``word`` names: a kind, what it needs after a colon; anything else is a file.

    Raises InputError.
    """
    if word in ("", "."):  # a shell variable that is not set
        raise InputError(f"the name of the controller is empty; allowed: {WORDS}")
    kind, _, argument = word.partition(":")
    if kind in KINDS:
        return KINDS[kind](argument)
    if not word or not (Path(word).suffix or Path(word).exists()):
        raise InputError(f"no controller '{word}'; allowed: {WORDS}")
    return FILES.get(Path(word).suffix.lower(), control.load_profile)(word)


def _off(argument: str) -> Controller:
    if argument:
        raise InputError(f"controller 'off:{argument}': off takes nothing after it")
    return control.off()


def _constant(argument: str) -> Controller:
    try:
        gauge = float(argument)
    except ValueError:
        raise InputError(f"controller 'constant:{argument}' needs a pressure in bar, as in constant:3.5") from None
    return control.Constant(gauge * BAR)


def _profile(argument: str) -> Controller:
    return control.load_profile(argument) if argument else control.tuned()


def _machine(argument: str) -> Controller:
    return machine.load(argument) if argument else machine.shipped()


KINDS: dict[str, Callable[[str], Controller]] = {
    "profile": _profile,
    "off": _off,
    "constant": _constant,
    "machine": _machine,
}
"""Kind -> what makes a controller of it from the text after the colon, which may be empty."""

FILES: dict[str, Callable[[str], Controller]] = {".toml": machine.load, ".npz": learned.load}
"""Ending of a file -> what reads a controller from it; all others are profiles."""
