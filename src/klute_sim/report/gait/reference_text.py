"""Names of the reference in the results of a gait run: people, or the one subject whose strides it holds."""

from klute_sim.gait.reference import DEFAULT_NAME

MAX_NAME_CHARS = 12
"""Longest name of a reference in a table or legend [characters]; longer ones are cut."""


def shorten_reference_name(name: str) -> str:
    """Return "human" for the default reference, and the name of another one, cut if it is long."""
    if name == DEFAULT_NAME:
        return "human"
    return name if len(name) <= MAX_NAME_CHARS else f"{name[: MAX_NAME_CHARS - 1]}…"


def describe_deviations(name: str) -> str:
    """Return whose standard deviations are the unit of the distances to the reference called ``name``."""
    if name == DEFAULT_NAME:
        return "standard deviations from people (rms)"
    return f"standard deviations between the strides of this subject from '{name}' (rms)"
