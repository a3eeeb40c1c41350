"""Parts of a device without a muscle: the section ``[cylinder]``, and which sections and effects need which part."""

from collections.abc import Collection
from typing import Annotated, Self

from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import PydanticCustomError

from klute_sim.device.schema.section import DeviceFileSection
from klute_sim.effects import catalogue
from klute_sim.laws import mckibben
from klute_sim.laws.mckibben import MuscleParameters

PART_OF_HOOK = {
    "acting_pressure": "muscle",
    "muscle_force": "muscle",
    "damper": "damper",
    "damper_force": "cylinder",
    "tendon_stretch": "tendon",
    "tendon_force": "tendon",
    "supply": "muscle",
    "pressure_target": "muscle",
    "pressure_reached": "muscle",
}
"""Hook of an effect -> section of the part that it acts on, in a device without a muscle."""
BEARING_PARTS = ("muscle", "cylinder", "tendon", "foot")
"""Sections of which a device has at least one."""
NEEDED_PARTS = {
    "damper": ("muscle", "cylinder"),
    "supply": ("muscle", "cylinder"),
    "valve": ("muscle",),
    "line": ("muscle",),
    "chamber": ("muscle",),
    "tank": ("muscle",),
    "leak": ("muscle",),
    "mounting": ("muscle",),
    "published": ("muscle",),
}
"""Section -> sections of which it needs one."""


class Cylinder(DeviceFileSection):
    """A cylinder in place of the muscle: a piston that moves between two stops, without a force of its own.

    A [damper] makes it hydraulic, and effects of the seal rub in it. The pressure does not push the piston: subtract
    pressure times area from a measured force.
    """

    extended_length_mm: Annotated[FiniteFloat, Field(ge=5, le=5000)]
    """Length with the piston at its outer stop."""
    stroke_mm: Annotated[FiniteFloat, Field(ge=1, le=2000)]
    """Distance between both stops."""

    @model_validator(mode="after")
    def _check_stroke(self) -> Self:
        if self.stroke_mm >= self.extended_length_mm:
            raise PydanticCustomError(
                "stroke",
                "stroke_mm is {stroke} but must be less than extended_length_mm, {length}",
                {"stroke": self.stroke_mm, "length": self.extended_length_mm},
            )
        return self

    def to_parameters(self) -> MuscleParameters:
        """Return the stops of the cylinder in SI units, as those of a muscle that is absent."""
        length = self.get_si("extended_length_mm")
        return mckibben.make_absent_muscle(length, length - self.get_si("stroke_mm"))


def check_parts(sections: Collection[str]) -> None:
    """Raise PydanticCustomError unless the ``sections`` of a device file fit together."""
    if "muscle" in sections and "cylinder" in sections:
        raise PydanticCustomError("part", "[cylinder] stands in place of [muscle]; remove one of them")
    if not set(BEARING_PARTS) & set(sections):
        raise PydanticCustomError("part", "no part; add [muscle], or one of [cylinder], [tendon] and [foot]")
    if "muscle" in sections and "supply" not in sections:
        raise PydanticCustomError("part", "section [supply] is missing; a [muscle] needs it")
    for title, parts in NEEDED_PARTS.items():
        if title in sections and not set(parts) & set(sections):
            raise PydanticCustomError(
                "part",
                "[{title}] needs a {parts}; add it, or remove [{title}]",
                {"title": title, "parts": " or a ".join(f"[{part}]" for part in parts)},
            )


def explain_missing_part(effect_name: str, sections: Collection[str]) -> str:
    """Return why effect ``effect_name`` cannot act in a device with these ``sections``, or ''.

    Without a muscle, an effect needs each part that it acts on. A data-driven force may stand in a cylinder, too.
    Effects of the body and of instruments need none of these parts; unknown effects are refused elsewhere.
    """
    effect = catalogue.get_effects().get(effect_name)
    if "muscle" in sections or effect is None or effect.kind != "device":
        return ""
    hooks = {hook: None for form in effect.forms for hook in form.laws if hook in PART_OF_HOOK}
    parts = [PART_OF_HOOK[hook] for hook in hooks] or ["muscle"]  # without a hook, the effect delays the command
    if effect.data_driven and "muscle_force" in hooks:
        parts = ["cylinder"]
    missing = next((part for part in parts if part not in sections), "")
    return f"[effects.{effect_name}] acts on the {missing}, but this device has no [{missing}]" if missing else ""
