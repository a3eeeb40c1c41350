"""Section ``[foot]`` of a device file: the compliance and the losses of the prosthetic foot below the ankle."""

from collections.abc import Mapping
from importlib import resources
from typing import Annotated, Any, Self

from pydantic import Field, FiniteFloat, model_validator
from pydantic_core import PydanticCustomError

from klute_sim.device.schema.section import DeviceFileSection
from klute_sim.errors import InputError, suggest
from klute_sim.files.toml import parse_toml
from klute_sim.laws.loading_cycle import CyclicStiffness, in_series

RIGID_FOOT = "rigid"
"""Preset of the foot of ``models/ankle.xml``, which a device without a section [foot] has."""
SHOE_SUFFIX = "+shoe"
"""Ending of the name of a foot in a shoe."""
SHOE_HEEL = CyclicStiffness(50e3, 0.77)
"""Sole of a shoe under the heel. The stiffness is assumed; with it, the loss raises that of a heel from 45 to 63 %, as
a walking shoe does (Klute, Berge and Segal 2004)."""
SHOE_FOREFOOT = CyclicStiffness(150e3, 0.5)
"""Sole of a shoe under the forefoot (assumed: a third as thick as under the heel)."""
SHOE_ASSUMPTIONS = {
    "shoe": "assumed: 50 N/mm under the heel, with a loss that raises 45 to 63 % (Klute, Berge and Segal 2004), and "
    "150 N/mm with a loss of 50 % under the forefoot"
}
"""Assumptions about a shoe."""
HEEL_KEYS = ("heel_stiffness_n_per_mm", "heel_loss_pct")
"""Keys that describe a heel."""
KEEL_KEYS = ("forefoot_stiffness_n_per_mm", "keel_loss_pct", "keel_lever_mm")
"""Keys that describe an elastic keel."""

Stiffness = Annotated[FiniteFloat, Field(ge=10, le=300)]
"""Stiffness [N/mm]: feet have 27 to 76; an empty shoe to a block of wood (assumed)."""
Loss = Annotated[FiniteFloat, Field(ge=2, le=80)]
"""Loss [%]: carbon laminates lose a few per cent, heels in orthopaedic shoes up to 82.4 % (Klute et al. 2004)."""


class FootSection(DeviceFileSection):
    """A prosthetic foot as a bench test measures it; keys that are left out are those of the preset."""

    preset: str | None = None
    """Foot whose numbers hold where this section has none; None: that of ``models/ankle.xml``."""
    shoe: bool = False
    """Whether the foot wears a shoe, whose sole is in series with heel and keel."""
    heel_stiffness_n_per_mm: Stiffness | None = None
    """Stiffness of the heel, pressed against a plate that is tilted by 15 degrees."""
    heel_loss_pct: Loss | None = None
    """Share of energy that the heel loses in a loading cycle."""
    forefoot_stiffness_n_per_mm: Stiffness | None = None
    """Stiffness of the forefoot, pressed against a plate that is tilted by 20 degrees; None: a rigid keel."""
    keel_loss_pct: Loss | None = None
    """Share of energy that the keel loses in a loading cycle."""
    keel_lever_mm: Annotated[FiniteFloat, Field(ge=80, le=150)] | None = None
    """Distance of the load from the axis of the ankle in the test of the forefoot."""

    @model_validator(mode="after")
    def _check_keys_are_complete(self) -> Self:
        for keys in (HEEL_KEYS, KEEL_KEYS):
            missing = [key for key in keys if getattr(self, key) is None]
            if missing and len(missing) < len(keys):
                raise PydanticCustomError(
                    "foot",
                    "[foot] lacks {missing}; allowed: all of {keys}, or none of them",
                    {"missing": ", ".join(missing), "keys": ", ".join(keys)},
                )
        return self

    @property
    def name(self) -> str:
        """Name of the foot as ``--foot`` takes it, or of the preset that was changed."""
        preset = read_foot_preset(self.preset or RIGID_FOOT)
        is_preset = all(getattr(self, key) == preset.get(key) for key in (*HEEL_KEYS, *KEEL_KEYS))
        name = (self.preset or RIGID_FOOT) if is_preset else f"changed {self.preset or RIGID_FOOT}"
        return name + (SHOE_SUFFIX if self.shoe else "")

    def get_heel(self, default: CyclicStiffness) -> CyclicStiffness:
        """Return the heel, with the shoe if there is one; ``default`` is the heel without numbers."""
        heel = default
        if self.heel_stiffness_n_per_mm is not None:
            heel = CyclicStiffness(self.get_si("heel_stiffness_n_per_mm"), self.get_si("heel_loss_pct"))
        return in_series(heel, SHOE_HEEL) if self.shoe else heel

    def get_forefoot(self) -> CyclicStiffness | None:
        """Return the forefoot in its test, with the shoe if there is one; None: a rigid keel without a shoe."""
        if self.forefoot_stiffness_n_per_mm is None:
            return SHOE_FOREFOOT if self.shoe else None
        keel = CyclicStiffness(self.get_si("forefoot_stiffness_n_per_mm"), self.get_si("keel_loss_pct"))
        return in_series(keel, SHOE_FOREFOOT) if self.shoe else keel

    @property
    def is_rigid(self) -> bool:
        """Whether the foot is that of ``models/ankle.xml``."""
        return not self.shoe and self.heel_stiffness_n_per_mm is None and self.forefoot_stiffness_n_per_mm is None


def list_feet() -> list[str]:
    """Return the names of the presets of feet."""
    folder = resources.files("klute_sim.device") / "feet"
    return sorted(file.name.removesuffix(".toml") for file in folder.iterdir() if file.name.endswith(".toml"))


def read_foot_preset(name: str) -> dict[str, Any]:
    """Return description, numbers and sources of the preset ``name``; raises InputError when there is none."""
    if name not in list_feet():
        hint = f"allowed: {', '.join(list_feet())}"
        raise InputError(f"there is no foot '{name}'; {suggest(name, list_feet(), hint)}")
    content = (resources.files("klute_sim.device") / "feet" / f"{name}.toml").read_bytes()
    return parse_toml(content, f"foot {name}")


def parse_foot_name(name: str) -> dict[str, Any]:
    """Return the section [foot] of a foot that the user named, such as ``sach`` or ``sach+shoe``.

    Raises InputError when there is no such foot.
    """
    preset = name.removesuffix(SHOE_SUFFIX)
    if preset not in list_feet():
        hint = f"allowed: {', '.join(list_feet())}, each also with {SHOE_SUFFIX} at its end"
        raise InputError(f"there is no foot '{name}'; {suggest(preset, list_feet(), hint)}")
    return {"preset": preset, "shoe": preset != name}


def expand_foot(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the ``content`` of a device file with the numbers and sources of the preset in its section [foot].

    Numbers of the section itself replace those of the preset.

    Raises InputError when there is no such preset.
    """
    section, sources = content.get("foot"), content.get("sources", {})
    if not isinstance(section, Mapping) or not isinstance(sources, Mapping):
        return dict(content)
    preset_name = section.get("preset", RIGID_FOOT)
    if not isinstance(preset_name, str):
        return dict(content)
    preset = read_foot_preset(preset_name)
    preset_sources = preset.pop("sources", {})
    del preset["description"]
    added_sources = {f"foot.{key}": text for key, text in preset_sources.items() if key not in section}
    return {**content, "foot": {**preset, **section}, "sources": {**added_sources, **sources}}
