"""The device file: its keys, their allowed values, and the SI parameters that they stand for.

A key ends with its unit. A value that is not allowed raises an error with the key, the value and the allowed range.
Only optional sections and keys have defaults.
"""

import math
from typing import Annotated, Any, Self

from pydantic import Field, FiniteFloat, ValidationError, field_validator, model_validator
from pydantic_core import PydanticCustomError

from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.outdated_sources import find_outdated_sources
from klute_sim.device.schema import effects as schema_effects
from klute_sim.device.schema import supply as schema_supply
from klute_sim.device.schema.foot import RIGID_FOOT, SHOE_ASSUMPTIONS, FootSection, expand_foot
from klute_sim.device.schema.muscle import Muscle
from klute_sim.device.schema.parts import Cylinder, check_parts, explain_missing_part
from klute_sim.device.schema.section import DeviceFileSection, NonNegative, Positive
from klute_sim.device.schema.supply import (
    Chamber,
    Leak,
    Line,
    Supply,
    Tank,
    Valve,
)
from klute_sim.effects.effect import Effect, EffectForm
from klute_sim.errors import InputError
from klute_sim.files.toml import validation_sentence
from klute_sim.laws import damper as damper_law
from klute_sim.laws import mckibben
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.tendon import TendonParameters

MAX_BORE_TO_ORIFICE_RATIO = 1000
"""Maximum ratio of bore to orifice; beyond it the damper locks (the muscle creeps micrometres in a stride)."""


class Damper(DeviceFileSection):
    """An orifice damper in parallel with the muscle, with a discharge coefficient of 1 as in the design."""

    bore_mm: Annotated[FiniteFloat, Field(ge=1, le=500)]
    """Bore of the cylinder."""
    orifice_concentric_mm: Positive
    """Diameter of the orifice that is open while the muscle shortens."""
    orifice_eccentric_mm: Positive
    """Diameter of the orifice that is open while the muscle lengthens."""
    oil_density_kg_m3: Annotated[FiniteFloat, Field(ge=100, le=2e4)]
    """Density of the oil."""

    @model_validator(mode="after")
    def _check_orifice_fits_bore(self) -> Self:
        for key in ("orifice_concentric_mm", "orifice_eccentric_mm"):
            if not self.bore_mm / MAX_BORE_TO_ORIFICE_RATIO <= getattr(self, key) <= self.bore_mm:
                raise PydanticCustomError(
                    "orifice",
                    "{key} is {value} but must be between bore_mm / {closed} and bore_mm, {bore}",
                    {
                        "key": key,
                        "value": getattr(self, key),
                        "bore": self.bore_mm,
                        "closed": MAX_BORE_TO_ORIFICE_RATIO,
                    },
                )
        return self

    def to_parameters(self) -> DamperParameters:
        """Return the parameters of the law in SI units."""
        bore, density = self.get_si("bore_mm"), self.get_si("oil_density_kg_m3")
        return DamperParameters(
            concentric_coefficient=damper_law.orifice_coefficient(
                bore, self.get_si("orifice_concentric_mm"), density, 1.0
            ),
            eccentric_coefficient=damper_law.orifice_coefficient(
                bore, self.get_si("orifice_eccentric_mm"), density, 1.0
            ),
            piston_area=0.25 * math.pi * bore * bore,
        )


class Tendon(DeviceFileSection):
    """Two offset parallel springs in series with muscle and damper."""

    slack_length_mm: Annotated[FiniteFloat, Field(ge=0, le=2000)]
    """Length at which the tendon becomes taut."""
    stiffness_1_n_per_mm: Annotated[FiniteFloat, Field(ge=0.1, le=1e5)]
    """Stiffness of the first spring."""
    stiffness_2_n_per_mm: Annotated[FiniteFloat, Field(ge=0, le=1e5)]
    """Stiffness of the second spring."""
    engagement_mm: Annotated[FiniteFloat, Field(ge=0, le=200)]
    """Stretch at which the second spring engages."""

    def to_parameters(self) -> TendonParameters:
        """Return the parameters of the law in SI units."""
        return TendonParameters(
            slack_length=self.get_si("slack_length_mm"),
            stiffness_1=self.get_si("stiffness_1_n_per_mm"),
            stiffness_2=self.get_si("stiffness_2_n_per_mm"),
            engagement_stretch=self.get_si("engagement_mm"),
            is_rigid=False,
        )


class Mounting(DeviceFileSection):
    """Length of the device when it is built into an ankle."""

    neutral_muscle_ratio: Annotated[FiniteFloat, Field(gt=0.6, le=1.0)]
    """Muscle length over resting length with the ankle at neutral and the tendon just taut."""
    alignment_deg: Annotated[FiniteFloat, Field(ge=-30.0, le=30.0)] | None = None
    """Angle by which the prosthesis is turned about its ankle axis against the limb, dorsiflexion positive; None: not
    chosen yet."""


class PublishedMeasurement(DeviceFileSection):
    """A published measurement of this device, for comparison with the model."""

    muscle_ratio: Annotated[FiniteFloat, Field(gt=0, le=1.0)]
    """Muscle length over resting length, lambda_1."""
    pressure_bar: NonNegative
    """Gauge pressure."""
    force_n: FiniteFloat
    """Measured force."""
    note: str
    """Source and remarks."""


PNEUMATIC_SECTIONS = ("supply", "valve", "line", "chamber", "tank", "leak")
"""Sections of the supply and the air."""
SECTION_OF_EFFECT = {
    "pressure_lag": "valve",
    "choked_valve": "valve",
    "hose": "line",
    "volume_coupling": "valve",
    "leak": "leak",
    "supply_droop": "tank",
}
"""Effect of an ideal regulator -> section that describes the same cause."""
EFFECTS_OF_RUBBER = ("thick_wall_bladder", "bladder_softening")
"""Effects on the rubber of the muscle's section, not on that of another effect."""


class DeviceSpec(DeviceFileSection):
    """Content of a device file."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the device."""
    description: str = ""
    """Description for the reader; the model does not use it."""
    accept: list[str] = Field(default=[])
    """Numbers (``section.key``) that are right although they are implausible."""
    muscle: Muscle | None = None
    """Muscle: one or more actuators; None: a cylinder, a tendon or a foot without a muscle."""
    cylinder: Cylinder | None = None
    """Cylinder in place of the muscle; None: the muscle, or a part without one."""
    damper: Damper | None = None
    """Damper in parallel with the muscle or in the cylinder; None: no damper."""
    tendon: Tendon | None = None
    """Tendon in series; None: a rigid tie of length 0 (a bare muscle on a tester)."""
    supply: Supply | None = None
    """Pressure regulator; None: a device without a muscle that is vented."""
    valve: Valve | None = None
    """Valve between regulator and muscle; None: the flow is not limited."""
    line: Line | None = None
    """Tube between valve and muscle; None: no tube."""
    chamber: Chamber | None = None
    """Air in the muscle; None: constant temperature."""
    tank: Tank | None = None
    """Tank that feeds the supply; None: the supply is unlimited."""
    leak: Leak | None = None
    """Leak of the muscle; None: no leak."""
    mounting: Mounting | None = None
    """Length for an ankle; None: the device cannot be built into an ankle."""
    foot: FootSection | None = None
    """Prosthetic foot below the ankle; None: that of ``models/ankle.xml``, whose keel is rigid."""
    effects: dict[str, dict[str, FiniteFloat | str]] = Field(default_factory=dict)
    """Effects beyond the dissertation's model: name -> parameters and, optionally, ``form``."""
    published: list[PublishedMeasurement] = Field(default_factory=list)
    """Published measurements of the device."""
    sources: dict[str, str] = Field(default_factory=dict)
    """``section.key`` -> source of the number; begins with 'assumed' where no source is published."""

    @model_validator(mode="after")
    def _check_parts(self) -> Self:
        check_parts(self.list_sections())
        return self

    @model_validator(mode="after")
    def _check_pneumatic_sections(self) -> Self:
        for title in ("line", "chamber"):
            if getattr(self, title) is not None and self.valve is None:
                raise PydanticCustomError(
                    "valve", "[{title}] needs a [valve]; add the section [valve], or remove [{title}]", {"title": title}
                )
        for effect in self.effects:
            reason = self.find_incompatibility(effect)
            if reason:
                raise PydanticCustomError("effect", "{reason}", {"reason": reason})
        return self

    @field_validator("name")
    @classmethod
    def _check_name(cls, name: str) -> str:
        if not name.isprintable():  # it stands in titles, tables and file names
            raise PydanticCustomError(
                "name", "{name} is refused; allowed: a name on one line of printable text", {"name": repr(name)}
            )
        return name

    @model_validator(mode="after")
    def _check_effects(self) -> Self:
        for name, content in self.effects.items():
            try:
                schema_effects.check_effect(name, content)
            except InputError as error:
                raise PydanticCustomError("effect", "{reason}", {"reason": str(error)}) from None
        return self

    @model_validator(mode="after")
    def _check_named_keys(self) -> Self:
        known = self.collect_values()
        for key in self.sources:
            if key not in known:
                raise PydanticCustomError(
                    "source", "[sources] refers to '{key}', which is not a numeric key of this file", {"key": key}
                )
        for key in self.accept:
            if key not in known:
                raise PydanticCustomError(
                    "accept", "'accept' names '{key}', which is not a numeric key of this file", {"key": key}
                )
        return self

    def can_add_effect(self, effect: Effect) -> bool:
        """Return whether ``effect`` can be added to this device, which does not have it yet."""
        is_built_in = effect.replaces_switch and getattr(self.muscle, effect.replaces_switch, False)
        return effect.name not in self.effects and not is_built_in and not self.find_incompatibility(effect.name)

    def list_candidate_forms(self, effect: Effect) -> list[EffectForm]:
        """Return the forms in which this device may lack ``effect``."""
        sections = self.list_sections()
        return [form for form in effect.forms if all(section in sections for section in form.candidate_sections)]

    def find_incompatibility(self, effect_name: str) -> str:
        """Return why ``effect_name`` contradicts the sections of this device, or ''."""
        missing_part = explain_missing_part(effect_name, self.list_sections())
        if missing_part:
            return missing_part
        title = SECTION_OF_EFFECT.get(effect_name, "")
        if title and getattr(self, title) is not None:
            return f"[effects.{effect_name}] and [{title}] describe the same cause; remove one of them"
        takes_openings = self.valve is not None and self.valve.command == "opening"
        if effect_name in ("regulator_error", "unknown_pressure") and takes_openings:
            return f"[effects.{effect_name}] needs pressure commands, but this [valve] has command = 'opening'"
        if effect_name in EFFECTS_OF_RUBBER and self.muscle is not None and not self.muscle.has_rubber:
            return (
                f"[effects.{effect_name}] changes the rubber of [muscle], which has none: bladder is false, or c10_kpa "
                "and c01_kpa are 0"
            )
        return ""

    def list_sections(self) -> list[str]:
        """Return the names of the sections of the file that describe parts and their use."""
        titles = ("muscle", "cylinder", "damper", "tendon", *PNEUMATIC_SECTIONS, "mounting", "foot")
        present = [title for title in titles if getattr(self, title) is not None]
        return [*present, "published"] if self.published else present

    def collect_values(self) -> dict[str, float]:
        """Return all numbers of the device: ``section.key`` -> value in the unit of the key."""
        numbers: dict[str, float] = {}
        for title in ("muscle", "cylinder", "damper", "tendon", *PNEUMATIC_SECTIONS, "mounting", "foot"):
            section = getattr(self, title)
            if section is not None:
                values = section.model_dump(exclude_none=True)
                numbers.update({f"{title}.{k}": v for k, v in values.items() if not isinstance(v, bool | str)})
        for effect, content in self.effects.items():
            numbers.update({f"effects.{effect}.{k}": v for k, v in content.items() if not isinstance(v, str)})
        return numbers

    def find_outdated_sources(self) -> dict[str, float]:
        """Return the keys whose source was copied from a preset with another value, with this value."""
        return find_outdated_sources(self.sources, self.collect_values())

    def collect_sources(self) -> dict[str, str]:
        """Return ``section.key`` -> source for the numbers whose source is not that of another value."""
        outdated = self.find_outdated_sources()
        return {key: source for key, source in self.sources.items() if key not in outdated}

    def collect_assumptions(self) -> dict[str, str]:
        """Return the assumed numbers: ``section.key`` -> reason."""
        return {key: source for key, source in self.collect_sources().items() if source.startswith("assumed")}

    def describe_foot(self) -> dict[str, Any]:
        """Return the name of the foot and what is assumed about it, in JSON types."""
        assumed = {key: reason for key, reason in self.collect_assumptions().items() if key.startswith("foot.")}
        if self.foot is None:
            return {"name": RIGID_FOOT, "assumed": assumed}
        return {"name": self.foot.name, "assumed": assumed | (SHOE_ASSUMPTIONS if self.foot.shoe else {})}

    def list_unsourced_keys(self) -> list[str]:
        """Return the ``section.key`` of all numbers without a source, or with the source of another value."""
        sources = self.collect_sources()
        return [key for key in self.collect_values() if key not in sources]

    def to_parameters(self) -> DeviceParameters:
        """Return the parameters in SI units, with neutral values for missing sections."""
        moving_part = self.muscle or self.cylinder
        return DeviceParameters(
            muscle=moving_part.to_parameters() if moving_part else mckibben.make_absent_muscle(0.0, 0.0),
            damper=self.damper.to_parameters() if self.damper else DamperParameters(0.0, 0.0),
            tendon=self.tendon.to_parameters() if self.tendon else TendonParameters(0.0, 0.0, 0.0, 0.0, is_rigid=True),
            supply=schema_supply.build_supply(*(getattr(self, title) for title in PNEUMATIC_SECTIONS)),
            effects=schema_effects.pack_effects(self.effects),
        )


OLD_KEYS = {
    "valve": {"takes": "command", "period_s": "pwm_period_s", "shortest_pulse_s": "min_pulse_s"},
    "chamber": {"warming_s": "thermal_time_constant_s"},
}
"""Section -> keys of the first format of device files, and their current names."""

MAX_REPORTED_PROBLEMS = 4
"""Maximum number of problems of one file in an error message."""


def parse_device_spec(content: dict[str, Any], source: str) -> DeviceSpec:
    """Check the ``content`` of a device file; ``source`` names the file in errors.

    Raises InputError with one sentence when something is wrong, or when the file has the first format.
    """
    _check_format(content, source)
    try:
        return DeviceSpec.model_validate(expand_foot(content))
    except InputError as error:
        raise InputError(f"device file {source}: {error}") from None
    except ValidationError as error:
        problems = validation_sentence(error, DeviceSpec, max_problems=MAX_REPORTED_PROBLEMS)
        raise InputError(f"device file {source}: {problems}") from None


def _check_format(content: dict[str, Any], source: str) -> None:
    """Raise InputError when ``content`` has keys of the first format of device files."""
    renamed = []
    for title, keys in OLD_KEYS.items():
        section = content.get(title)
        if isinstance(section, dict):
            renamed += [f"{title}.{old} to {title}.{new}" for old, new in keys.items() if old in section]
    if renamed:
        raise InputError(f"device file {source} has the first format; rename {', '.join(renamed)}")
