"""The device file: which keys exist, what each may hold, and the SI parameters they stand for.

A key carries its unit at its end. What is not allowed is refused with the key, the value and what would be
allowed; nothing is defaulted silently except what this page says may be left out.
"""

import math
from typing import Annotated, Any, Self

from pydantic import Field, FiniteFloat, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.schema import effects as schema_effects
from klute_sim.device.schema import supply as schema_supply
from klute_sim.device.schema.section import DeviceFileSection, NonNegative, Positive
from klute_sim.device.schema.supply import (
    ChamberSection,
    LeakSection,
    LineSection,
    SupplySection,
    TankSection,
    ValveSection,
)
from klute_sim.effects.effect import Effect
from klute_sim.errors import InputError
from klute_sim.laws import damper as damper_law
from klute_sim.laws.damper import Damper
from klute_sim.laws.mckibben import Muscle
from klute_sim.laws.tendon import Tendon

MAX_RADIUS_MISMATCH = 0.05
"""How far the radius that braid and turns imply may be from the bladder's (Table 3.1: up to 2.6 %)."""

MAX_BORE_TO_ORIFICE_RATIO = 1000
"""Bore over orifice beyond which an orifice is none: the muscle creeps micrometres in a stride."""


class MuscleSection(DeviceFileSection):
    """``count`` equal McKibben actuators side by side."""

    count: Annotated[int, Field(ge=1, le=100)] = 1
    """Actuators in parallel."""
    resting_length_mm: Annotated[FiniteFloat, Field(ge=20, le=2000)]
    """L0."""
    braid_length_ratio: Annotated[FiniteFloat, Field(gt=1.0, lt=math.sqrt(3.0))]
    """B/L0; a braid as long as the muscle could not wind, one of sqrt(3) L0 is locked at rest."""
    turns_per_m: Positive
    """N/L0."""
    bladder_radius_mm: Positive
    """R0, outer."""
    bladder_thickness_mm: Positive
    """t0."""
    c10_kpa: NonNegative
    c01_kpa: NonNegative
    friction_slope_n_per_bar: FiniteFloat
    """m, per actuator."""
    friction_offset_n: FiniteFloat
    """b, per actuator, signed as printed."""
    bladder: bool = True
    """False leaves the bladder term out (the geometric model)."""
    friction: bool = True
    """False leaves the friction offset out."""

    @model_validator(mode="after")
    def _check_bladder_fits_braid(self) -> Self:
        if self.bladder_thickness_mm >= self.bladder_radius_mm:
            raise PydanticCustomError(
                "wall",
                "bladder_thickness_mm is {t} but must be less than bladder_radius_mm, {r}",
                {"t": self.bladder_thickness_mm, "r": self.bladder_radius_mm},
            )
        ratio = self.braid_length_ratio
        braid_radius = 1e3 * math.sqrt(ratio * ratio - 1.0) / (2.0 * math.pi * self.turns_per_m)
        if abs(braid_radius / self.bladder_radius_mm - 1.0) > MAX_RADIUS_MISMATCH:
            raise PydanticCustomError(
                "radius",
                "bladder_radius_mm is {r} but braid_length_ratio and turns_per_m imply a radius of "
                "{b} mm; the two must agree within 5 %",
                {"r": self.bladder_radius_mm, "b": f"{braid_radius:.2f}"},
            )
        return self

    def to_parameters(self) -> Muscle:
        """The law's parameters, SI."""
        length = self.get_si("resting_length_mm")
        return Muscle(
            n_actuators=float(self.count),
            resting_length=length,
            braid_length=self.braid_length_ratio * length,
            braid_turns=self.turns_per_m * length,
            bladder_radius=self.get_si("bladder_radius_mm"),
            bladder_thickness=self.get_si("bladder_thickness_mm"),
            c10=self.get_si("c10_kpa") if self.bladder else 0.0,
            c01=self.get_si("c01_kpa") if self.bladder else 0.0,
            friction_slope=self.get_si("friction_slope_n_per_bar") if self.friction else 0.0,
            friction_offset=self.get_si("friction_offset_n") if self.friction else 0.0,
        )


class DamperSection(DeviceFileSection):
    """An orifice damper in parallel with the muscle, discharge coefficient 1 as in the design."""

    bore_mm: Positive
    orifice_concentric_mm: Positive
    """Open while shortening."""
    orifice_eccentric_mm: Positive
    """Open while lengthening."""
    oil_density_kg_m3: Positive

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

    def to_parameters(self) -> Damper:
        """The law's parameters, SI."""
        bore, density = self.get_si("bore_mm"), self.get_si("oil_density_kg_m3")
        return Damper(
            concentric_coefficient=damper_law.orifice_coefficient(
                bore, self.get_si("orifice_concentric_mm"), density, 1.0
            ),
            eccentric_coefficient=damper_law.orifice_coefficient(
                bore, self.get_si("orifice_eccentric_mm"), density, 1.0
            ),
        )


class TendonSection(DeviceFileSection):
    """Two offset parallel springs in series with muscle and damper."""

    slack_length_mm: Annotated[FiniteFloat, Field(ge=0, le=2000)]
    stiffness_1_n_per_mm: Annotated[FiniteFloat, Field(ge=0.1, le=1e5)]
    stiffness_2_n_per_mm: Annotated[FiniteFloat, Field(ge=0, le=1e5)]
    engagement_mm: Annotated[FiniteFloat, Field(ge=0, le=200)]

    def to_parameters(self) -> Tendon:
        """The law's parameters, SI."""
        return Tendon(
            slack_length=self.get_si("slack_length_mm"),
            stiffness_1=self.get_si("stiffness_1_n_per_mm"),
            stiffness_2=self.get_si("stiffness_2_n_per_mm"),
            engagement_stretch=self.get_si("engagement_mm"),
            is_rigid=False,
        )


class MountingSection(DeviceFileSection):
    """How the device is cut to length when it is built into an ankle."""

    neutral_muscle_ratio: Annotated[FiniteFloat, Field(gt=0.6, le=1.0)]
    """Muscle length over L0 with the ankle at neutral and the tendon just taut."""


class PublishedMeasurement(DeviceFileSection):
    """A published measurement of this device, to lay beside the model."""

    muscle_ratio: Annotated[FiniteFloat, Field(gt=0, le=1.0)]
    """lambda_1 at which it was taken."""
    pressure_bar: NonNegative
    force_n: FiniteFloat
    note: str


PNEUMATIC_SECTIONS = ("supply", "valve", "line", "chamber", "tank", "leak")
"""Sections on air."""
SECTION_OF_EFFECT = {
    "pressure_lag": "valve",
    "choked_valve": "valve",
    "volume_coupling": "valve",
    "leak": "leak",
    "supply_droop": "tank",
}
"""Effects that say of a regulator what a section says already."""


class DeviceSpec(DeviceFileSection):
    """One device file."""

    name: Annotated[str, Field(min_length=1)]
    description: str = ""
    muscle: MuscleSection
    damper: DamperSection | None = None
    """Left out: no damper."""
    tendon: TendonSection | None = None
    """Left out: a rigid tie of length 0 (a bare muscle on a tester)."""
    supply: SupplySection
    valve: ValveSection | None = None
    """Left out: the regulator gives any flow."""
    line: LineSection | None = None
    chamber: ChamberSection | None = None
    """Left out: air at constant temperature, no dead volume."""
    tank: TankSection | None = None
    """Left out: the supply never ends."""
    leak: LeakSection | None = None
    mounting: MountingSection | None = None
    """Left out: the device cannot be built into an ankle."""
    effects: dict[str, dict[str, FiniteFloat | str]] = Field(default_factory=dict)
    """What the dissertation's model leaves out: effect -> ``form`` (left out: the usual one) and its parameters."""
    published: list[PublishedMeasurement] = Field(default_factory=list)
    sources: dict[str, str] = Field(default_factory=dict)
    """``section.key`` -> where the number is from; begins with 'assumed' if nobody printed it."""

    @model_validator(mode="after")
    def _check_pneumatic_sections(self) -> Self:
        for title in ("line", "chamber"):
            if getattr(self, title) is not None and self.valve is None:
                raise PydanticCustomError(
                    "valve", "[{title}] needs a [valve]: an ideal regulator has no use for it", {"title": title}
                )
        for effect in self.effects:
            obstacle = self.find_incompatibility(effect)
            if obstacle:
                raise PydanticCustomError("effect", "{why}", {"why": obstacle})
        return self

    @model_validator(mode="after")
    def _check_effects(self) -> Self:
        for name, content in self.effects.items():
            try:
                schema_effects.check_effect(name, content)
            except InputError as error:
                raise PydanticCustomError("effect", "{why}", {"why": str(error)}) from None
        return self

    @model_validator(mode="after")
    def _check_sources(self) -> Self:
        known = self.collect_values()
        for key in self.sources:
            if key not in known:
                raise PydanticCustomError(
                    "source", "sources names '{key}', which is no number of this file", {"key": key}
                )
        return self

    def can_add_effect(self, effect: Effect) -> bool:
        """Whether ``effect`` is one that this device is without and could have."""
        there = effect.replaces_switch and getattr(self.muscle, effect.replaces_switch)
        return effect.name not in self.effects and not there and not self.find_incompatibility(effect.name)

    def find_incompatibility(self, effect_name: str) -> str:
        """Why this device cannot have ``effect`` beside what its sections say, or ''."""
        title = SECTION_OF_EFFECT.get(effect_name, "")
        if title and getattr(self, title) is not None:
            return f"[effects.{effect_name}] and [{title}] say the same twice; leave one out"
        opened = self.valve is not None and self.valve.takes == "opening"
        if effect_name in ("regulator_error", "unknown_pressure") and opened:
            return f"[effects.{effect_name}] needs commands that are pressures; this [valve] takes openings"
        return ""

    def collect_values(self) -> dict[str, float]:
        """Every number of the device, ``section.key`` -> value as written in the file."""
        found: dict[str, float] = {}
        for title in ("muscle", "damper", "tendon", *PNEUMATIC_SECTIONS, "mounting"):
            section = getattr(self, title)
            if section is not None:
                values = section.model_dump(exclude_none=True)
                found.update({f"{title}.{k}": v for k, v in values.items() if not isinstance(v, bool | str)})
        for effect, content in self.effects.items():
            found.update({f"effects.{effect}.{k}": v for k, v in content.items() if not isinstance(v, str)})
        return found

    def collect_assumptions(self) -> dict[str, str]:
        """The numbers nobody printed, ``section.key`` -> why."""
        return {k: v for k, v in self.sources.items() if v.startswith("assumed")}

    def list_unsourced_keys(self) -> list[str]:
        """The numbers that the file gives no source for, ``section.key``."""
        return [key for key in self.collect_values() if key not in self.sources]

    def to_parameters(self) -> DeviceParameters:
        """The law's parameters, SI, with neutral stand-ins for what is left out."""
        return DeviceParameters(
            muscle=self.muscle.to_parameters(),
            damper=self.damper.to_parameters() if self.damper else Damper(0.0, 0.0),
            tendon=self.tendon.to_parameters() if self.tendon else Tendon(0.0, 0.0, 0.0, 0.0, is_rigid=True),
            supply=schema_supply.build_supply(*(getattr(self, title) for title in PNEUMATIC_SECTIONS)),
            effects=schema_effects.pack_effects(self.effects),
        )


def parse_device_spec(content: dict[str, Any], source: str) -> DeviceSpec:
    """Check the ``content`` of a device file found at ``where``; raises InputError with one sentence."""
    try:
        return DeviceSpec.model_validate(content)
    except ValidationError as error:
        raise InputError(_format_error(error, source)) from None


MAX_REPORTED_PROBLEMS = 4
"""Problems of one file that are told at once."""


def _format_error(error: ValidationError, source: str) -> str:
    # An unknown key is often the misspelt one that is also missing.
    problems = sorted(error.errors(include_url=False), key=lambda problem: problem["type"] != "extra_forbidden")
    told = "; ".join(_format_problem(problem) for problem in problems[:MAX_REPORTED_PROBLEMS])
    more = f" (and {len(problems) - MAX_REPORTED_PROBLEMS} more)" if len(problems) > MAX_REPORTED_PROBLEMS else ""
    return f"device file {source}: {told}{more}"


def _format_problem(problem: ErrorDetails) -> str:
    key = ".".join(str(part) for part in problem["loc"])
    if problem["type"] == "extra_forbidden":
        return f"unknown key '{key}'; allowed here: {', '.join(_list_allowed_keys(problem['loc']))}"
    if problem["type"] == "missing":
        return f"key '{key}' is missing"
    if problem["type"] in {"wall", "radius", "orifice", "source", "effect", "valve"}:
        return f"[{key}] {problem['msg']}" if key else problem["msg"]
    return f"{key} = {problem['input']!r} is refused: {problem['msg'][0].lower()}{problem['msg'][1:]}"


def _list_allowed_keys(location: tuple[int | str, ...]) -> list[str]:
    sections: dict[str, type[DeviceFileSection]] = {
        "muscle": MuscleSection,
        "damper": DamperSection,
        "tendon": TendonSection,
        "supply": SupplySection,
        "valve": ValveSection,
        "line": LineSection,
        "chamber": ChamberSection,
        "tank": TankSection,
        "leak": LeakSection,
        "mounting": MountingSection,
        "published": PublishedMeasurement,
    }
    owner = sections.get(str(location[0]), DeviceSpec) if len(location) > 1 else DeviceSpec
    return list(owner.model_fields)
