"""What there is to say of an effect: the same on the command line (``klute-sim effects``) and on its page in docs."""

import math
from typing import TYPE_CHECKING, Any

from klute_sim import units

if TYPE_CHECKING:
    from klute_sim.effects.effect import Effect, EffectForm, EffectParameter

SIGNATURE_DEVICE = "klute-3-4-pair"
"""Preset on which signatures are computed, unless another is named."""
HOOK_DESCRIPTIONS = {
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
COMMAND_DESCRIPTION = "the pressure command as a whole"
"""Where an effect without laws acts."""
PARAMETER_HEADINGS = ("parameter", "unit", "without effect", "range", "typical", "source")
NO_DISTINGUISHING_CHANGE = "no change of the rig"
"""What splits a class that nothing splits."""


def describe_effect(effect: "Effect") -> dict[str, Any]:
    """Everything there is to say of ``effect``, ready for JSON."""
    return {
        "name": effect.name,
        "sentence": effect.description,
        "kind": effect.kind,
        "supply": effect.acts_in_supply,
        "data_driven": effect.data_driven,
        "instead_of": effect.replaces_switch or None,
        "forms": [
            {
                "name": form.name,
                "equation": form.equation,
                "hooks": list(form.laws),
                "parameters": [_describe_parameter(effect, parameter) for parameter in form.parameters],
                "device_file": format_device_toml(effect, form),
            }
            for form in effect.forms
        ],
    }


def format_device_toml(effect: "Effect", form: "EffectForm") -> str | None:
    """The lines of a device file that have ``effect`` in it at its typical size; None for one of instruments."""
    if effect.kind == "instrument":
        return None
    numbers = (f"{parameter.key} = {float(parameter.typical)!r}" for parameter in form.parameters)
    needs = [f"# needs {effect.replaces_switch} = false in [muscle]"] if effect.replaces_switch else []
    return "\n".join([*needs, f"[effects.{effect.name}]", f'form = "{form.name}"', *numbers])


def get_parameter_unit(effect: "Effect", parameter: "EffectParameter") -> str:
    """The unit of ``parameter`` by the end of its key; an instrument's without bounds has that of its channel."""
    if effect.kind == "instrument" and math.isinf(parameter.upper):
        return "channel's unit/s" if parameter.key.endswith("_per_s") else "channel's unit"
    return units.split_unit(parameter.key)[1] or "1"


def _describe_parameter(effect: "Effect", parameter: "EffectParameter") -> dict[str, Any]:
    return {
        "key": parameter.key,
        "unit": get_parameter_unit(effect, parameter),
        "neutral": parameter.neutral,
        "low": parameter.lower if math.isfinite(parameter.lower) else None,
        "high": parameter.upper if math.isfinite(parameter.upper) else None,
        "typical": parameter.typical,
        "source": parameter.source,
        "assumed": parameter.source.startswith("assumed"),
    }


def describe_kind(description: dict[str, Any]) -> str:
    """What sort of effect :func:`describe` has described, as a sentence."""
    if description["kind"] == "instrument":
        return (
            "An effect of an instrument. It is never in a device file: a diagnosis looks for it in every measured "
            "channel."
        )
    if description["kind"] == "body":
        return (
            "An effect of the body that the device is built into. It shows on walks: a diagnosis of gait looks for it, "
            "and `klute-sim gait` walks with it. On a bench there is no body."
        )
    if description["data_driven"]:
        return (
            "A data-driven term of the device, which names nothing: a diagnosis falls back on it where no effect is "
            "enough. It is not guaranteed to be passive: nothing keeps it from giving "
            "energy, and outside of the data it was fitted to it may do anything within its bounds. A device file may "
            "leave out coefficients that are 0."
        )
    if description["supply"]:
        return "An effect of the device, in its gas supply, which may do work."
    return "An effect of the device, not of its gas supply."


def describe_hooks(form: dict[str, Any]) -> str:
    """Where a form acts, as a sentence."""
    places = "; ".join(f"{hook}: {HOOK_DESCRIPTIONS[hook]}" for hook in form["hooks"]) or COMMAND_DESCRIPTION
    return f"It acts on {places}."


def format_default_note(index: int, forms: list[dict[str, Any]]) -> str:
    """What is behind the name of form ``number``: the first of several is the usual one."""
    return " (the usual one)" if index == 0 and len(forms) > 1 else ""


def format_parameter_cells(parameter: dict[str, Any]) -> tuple[str, ...]:
    """A parameter under :data:`PARAMETER_HEAD`."""
    neutral = "none: a shape" if parameter["neutral"] is None else f"{parameter['neutral']:g}"
    typical = f"{parameter['typical']:g}"
    return parameter["key"], parameter["unit"], neutral, _format_range(parameter), typical, parameter["source"]


def _format_range(parameter: dict[str, Any]) -> str:
    if parameter["low"] is None and parameter["high"] is None:
        return "any"
    if parameter["low"] is None or parameter["high"] is None:
        return f"from {parameter['low']:g}" if parameter["high"] is None else f"up to {parameter['high']:g}"
    return f"{parameter['low']:g} to {parameter['high']:g}"
