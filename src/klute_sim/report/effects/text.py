"""Description of an effect, shared by the command line (``klute-sim effects``) and its page in the documentation."""

import math
from typing import TYPE_CHECKING, Any

from klute_sim import units

if TYPE_CHECKING:
    from klute_sim.effects.effect import Effect, EffectForm, EffectParameter

SIGNATURE_DEVICE = "klute-3-4-pair"
"""Default device preset for signatures."""
HOOK_DESCRIPTIONS = {
    "acting_pressure": "the pressure that acts on the muscle",
    "muscle_force": "the tension of the muscle",
    "damper": "the parameters of the damper",
    "damper_force": "the tension of the damper",
    "tendon_stretch": "the stretch of the tendon",
    "tendon_force": "the tension of the tendon",
    "supply": "the parameters of the supply",
    "pressure_target": "the setpoint of the pressure regulator",
    "pressure_reached": "the pressure at the end of a time step",
    "next_state": "the internal state of the effect",
    "reading": "the reading of an instrument",
    "foot": "the parameters of foot and ankle",
    "joint": "inertia, damping and friction of a joint",
    "pulley": "the radius of a pulley",
    "gravity": "the direction of gravity",
}
"""Hook -> the quantity that an effect changes there."""
COMMAND_DESCRIPTION = "the entire history of the pressure command"
"""Quantity that an effect without hooks changes."""
PARAMETER_HEADINGS = ("parameter", "unit", "neutral", "range", "typical", "source")
NO_DISTINGUISHING_CHANGE = "no change of the rig"
"""Text for indistinguishable effects that no change of the rig separates."""


def describe_effect(effect: "Effect") -> dict[str, Any]:
    """Return the complete description of ``effect`` as JSON types."""
    return {
        "name": effect.name,
        "description": effect.description,
        "kind": effect.kind,
        "acts_in_supply": effect.acts_in_supply,
        "data_driven": effect.data_driven,
        "replaces_switch": effect.replaces_switch or None,
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
    """Return the lines of a device file that add ``effect`` with typical parameters; None where no device has it."""
    if effect.kind in ("instrument", "mechanism"):
        return None
    lines = (f"{parameter.key} = {float(parameter.typical)!r}" for parameter in form.parameters)
    requirement = [f"# requires {effect.replaces_switch} = false in [muscle]"] if effect.replaces_switch else []
    return "\n".join([*requirement, f"[effects.{effect.name}]", f'form = "{form.name}"', *lines])


def get_parameter_unit(effect: "Effect", parameter: "EffectParameter") -> str:
    """Return the unit of ``parameter`` from its key; unbounded parameters of instruments have that of their channel."""
    if effect.kind in ("instrument", "mechanism") and math.isinf(parameter.upper):
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
    """Return the kind of the effect in :func:`describe_effect`'s ``description`` as a sentence."""
    if description["kind"] == "instrument":
        return (
            "An instrument effect. It is never part of a device file; a diagnosis tests it in every measured channel."
        )
    if description["kind"] == "body" and description["data_driven"]:
        return (
            "A data-driven term of the ankle. It identifies no effect: a diagnosis of walks uses it where no effect "
            "explains the data. It may generate energy, and it depends on the measured load, so `klute-sim gait` "
            "refuses a device file that has it. A device file may omit coefficients that are 0."
        )
    if description["kind"] == "body":
        return (
            "A body effect: it acts on the foot and the ankle. `klute-sim gait` and a diagnosis of gait trials include "
            "it; a bench test has no body."
        )
    if description["kind"] == "mechanism" and description["data_driven"]:
        return (
            "A data-driven term of a joint of an MJCF model. It identifies no effect: a diagnosis of a dataset with "
            '`rig = "mjcf"` uses it where no effect explains the data. It may generate energy, and its polynomials do '
            "not extrapolate beyond the positions of the data. A device file cannot have it."
        )
    if description["kind"] == "mechanism":
        return (
            "An effect of a mechanism: it acts on joints, pulleys, gravity or sensors of an MJCF model. A diagnosis of "
            'a dataset with `rig = "mjcf"` tests it; a device file cannot have it.'
        )
    if description["data_driven"]:
        return (
            "A data-driven term of the device. It identifies no effect: a diagnosis uses it where no effect explains "
            "the data. It is not guaranteed to be passive, so it may generate energy. Outside the data to which it was "
            "fitted, it may take any value within its bounds. A device file may omit coefficients that are 0."
        )
    if description["acts_in_supply"]:
        return "A device effect in the gas supply; it may add energy to the device."
    return "A device effect outside the gas supply; at constant pressure it adds no energy."


def describe_hooks(form: dict[str, Any]) -> str:
    """Return the quantities on which a form acts, as a sentence."""
    quantities = "; ".join(f"{hook}: {HOOK_DESCRIPTIONS[hook]}" for hook in form["hooks"]) or COMMAND_DESCRIPTION
    return f"It acts on {quantities}."


def format_default_note(index: int, forms: list[dict[str, Any]]) -> str:
    """Return the note behind the name of form ``index``: the first of several forms is the default."""
    return " (default)" if index == 0 and len(forms) > 1 else ""


def format_parameter_cells(parameter: dict[str, Any]) -> tuple[str, ...]:
    """Return the cells of a parameter under :data:`PARAMETER_HEADINGS`."""
    neutral = "none (shape parameter)" if parameter["neutral"] is None else f"{parameter['neutral']:g}"
    typical = f"{parameter['typical']:g}"
    return parameter["key"], parameter["unit"], neutral, _format_range(parameter), typical, parameter["source"]


def _format_range(parameter: dict[str, Any]) -> str:
    if parameter["low"] is None and parameter["high"] is None:
        return "any"
    if parameter["low"] is None or parameter["high"] is None:
        return f"from {parameter['low']:g}" if parameter["high"] is None else f"up to {parameter['high']:g}"
    return f"{parameter['low']:g} to {parameter['high']:g}"
