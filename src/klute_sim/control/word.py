"""A controller in one word, as it is typed: ``off``, ``constant:3.5``, ``profile``, ``mine.csv``."""

from collections.abc import Callable
from pathlib import Path

from klute_sim.control import pressure as control
from klute_sim.control.pressure import PressureController
from klute_sim.errors import InputError
from klute_sim.units import BAR

WORDS = "profile, off, constant:BAR, or the CSV file of a profile"
"""What can be typed, for help and errors."""


def parse(word: str) -> PressureController:
    """The controller that ``word`` names: a kind, what it needs after a colon; anything else is a profile's file.

    Raises InputError.
    """
    kind, _, argument = word.partition(":")
    if kind in KINDS:
        return KINDS[kind](argument)
    if not word or not (Path(word).suffix or Path(word).exists()):
        raise InputError(f"no controller '{word}'; allowed: {WORDS}")
    return control.load_profile(word)


def _off(argument: str) -> PressureController:
    if argument:
        raise InputError(f"controller 'off:{argument}': off takes nothing after it")
    return control.off()


def _constant(argument: str) -> PressureController:
    try:
        gauge = float(argument)
    except ValueError:
        raise InputError(f"controller 'constant:{argument}' needs a pressure in bar, as in constant:3.5") from None
    return control.Constant(gauge * BAR)


def _profile(argument: str) -> PressureController:
    return control.load_profile(argument) if argument else control.tuned()


KINDS: dict[str, Callable[[str], PressureController]] = {"profile": _profile, "off": _off, "constant": _constant}
"""Kind -> what makes a controller of it from the text after the colon, which may be empty."""
