"""What there is to say of an effect: the same on the command line (``klute-sim effects``) and on its page in docs."""

import math
from typing import TYPE_CHECKING, Any

from klute_sim import units

if TYPE_CHECKING:
    from klute_sim.effects.effect import Effect, Form, Parameter

DEVICE = "klute-3-4-pair"
"""Preset on which signatures are computed, unless another is named."""
PLACES = {
    "acting_pressure": "the pressure that the muscle feels",
    "muscle_force": "the muscle's tension",
    "damper_force": "the damper's tension",
    "tendon_stretch": "the tendon's stretch",
    "tendon_force": "the tendon's tension",
    "supply": "what the supply is",
    "pressure_target": "the pressure that is regulated to",
    "pressure_reached": "how the pressure follows",
    "remember": "its own memory",
    "reading": "what an instrument shows",
    "foot": "what the foot and its ankle are",
}
"""Hook -> what a law changes there."""
WHOLE_SERIES = "the pressure command as a whole"
"""Where an effect without laws acts."""
PARAMETER_HEAD = ("parameter", "unit", "without effect", "range", "typical", "source")
NO_SPLIT = "no change of the rig"
"""What splits a class that nothing splits."""


def describe(effect: "Effect") -> dict[str, Any]:
    """Everything there is to say of ``effect``, ready for JSON."""
    return {
        "name": effect.name,
        "sentence": effect.sentence,
        "kind": effect.kind,
        "supply": effect.supply,
        "data_driven": effect.data_driven,
        "instead_of": effect.instead_of or None,
        "forms": [
            {
                "name": form.name,
                "equation": form.equation,
                "hooks": list(form.laws),
                "parameters": [_parameter(effect, parameter) for parameter in form.parameters],
                "device_file": snippet(effect, form),
            }
            for form in effect.forms
        ],
    }


def snippet(effect: "Effect", form: "Form") -> str | None:
    """The lines of a device file that have ``effect`` in it at its typical size; None for one of instruments."""
    if effect.kind == "instrument":
        return None
    numbers = (f"{parameter.key} = {float(parameter.typical)!r}" for parameter in form.parameters)
    needs = [f"# needs {effect.instead_of} = false in [muscle]"] if effect.instead_of else []
    return "\n".join([*needs, f"[effects.{effect.name}]", f'form = "{form.name}"', *numbers])


def unit(effect: "Effect", parameter: "Parameter") -> str:
    """The unit of ``parameter`` by the end of its key; an instrument's without bounds has that of its channel."""
    if effect.kind == "instrument" and math.isinf(parameter.high):
        return "channel's unit/s" if parameter.key.endswith("_per_s") else "channel's unit"
    return units.split(parameter.key)[1] or "1"


def _parameter(effect: "Effect", parameter: "Parameter") -> dict[str, Any]:
    return {
        "key": parameter.key,
        "unit": unit(effect, parameter),
        "neutral": parameter.neutral,
        "low": parameter.low if math.isfinite(parameter.low) else None,
        "high": parameter.high if math.isfinite(parameter.high) else None,
        "typical": parameter.typical,
        "source": parameter.source,
        "assumed": parameter.source.startswith("assumed"),
    }


def kind(shown: dict[str, Any]) -> str:
    """What sort of effect :func:`describe` has described, as a sentence."""
    if shown["kind"] == "instrument":
        return (
            "An effect of an instrument. It is never in a device file: a diagnosis looks for it in every measured "
            "channel."
        )
    if shown["kind"] == "body":
        return (
            "An effect of the body that the device is built into. It shows on walks: a diagnosis of gait looks for it, "
            "and `klute-sim gait` walks with it. On a bench there is no body."
        )
    if shown["data_driven"]:
        return (
            "A data-driven term of the device, which names nothing: a diagnosis falls back on it where no effect is "
            "enough. It is not guaranteed to be passive: nothing keeps it from giving "
            "energy, and outside of the data it was fitted to it may do anything within its bounds. A device file may "
            "leave out coefficients that are 0."
        )
    if shown["supply"]:
        return "An effect of the device, in its gas supply, which may do work."
    return "An effect of the device, not of its gas supply."


def acts(form: dict[str, Any]) -> str:
    """Where a form acts, as a sentence."""
    places = "; ".join(f"{hook}: {PLACES[hook]}" for hook in form["hooks"]) or WHOLE_SERIES
    return f"It acts on {places}."


def usual(number: int, forms: list[dict[str, Any]]) -> str:
    """What is behind the name of form ``number``: the first of several is the usual one."""
    return " (the usual one)" if number == 0 and len(forms) > 1 else ""


def cells(parameter: dict[str, Any]) -> tuple[str, ...]:
    """A parameter under :data:`PARAMETER_HEAD`."""
    neutral = "none: a shape" if parameter["neutral"] is None else f"{parameter['neutral']:g}"
    typical = f"{parameter['typical']:g}"
    return parameter["key"], parameter["unit"], neutral, _range(parameter), typical, parameter["source"]


def _range(row: dict[str, Any]) -> str:
    if row["low"] is None and row["high"] is None:
        return "any"
    if row["low"] is None or row["high"] is None:
        return f"from {row['low']:g}" if row["high"] is None else f"up to {row['high']:g}"
    return f"{row['low']:g} to {row['high']:g}"
