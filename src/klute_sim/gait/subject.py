"""A subject: the reference gait that the rig follows, the body, the walking speed and the ground."""

import math
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

from klute_sim.errors import InputError
from klute_sim.gait.reference import Reference, check_stride_time, load_default_reference, load_reference
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE
from klute_sim.gait.rig.setup import GaitOptions
from klute_sim.gait.spring_foot import SpringFoot

ReferenceLike: TypeAlias = Reference | str | Path | None
"""A reference gait, the path of its file or folder, or None for able-bodied adults."""


@dataclass(frozen=True, kw_only=True)
class Subject:
    """A person who walks: gait, body, speed and slope; validated when made."""

    reference: Reference = field(default_factory=load_default_reference)
    """Gait that the rig follows, and that results are compared with."""
    mass: float = MODEL_MASS
    """Body mass [kg]."""
    stature: float = MODEL_STATURE
    """Body height [m]."""
    speed: float | None = None
    """Walking speed [m/s]; None: the speed that reference and leg length imply."""
    slope_deg: float = 0.0
    """Ground slope [deg], uphill positive; in degrees, so that tables show the number that the user typed."""

    def __post_init__(self) -> None:
        """Raise InputError when a number is out of range."""
        self.build_options()

    def build_options(
        self, strides: int = GaitOptions.strides, dt: float = GaitOptions.dt, spring_foot: SpringFoot | None = None
    ) -> GaitOptions:
        """Return the options of a gait run with a time step ``dt`` [s]; raises InputError when one is out of range."""
        return GaitOptions(
            mass=self.mass,
            stature=self.stature,
            speed=self.speed,
            slope=math.radians(self.slope_deg),
            strides=strides,
            dt=dt,
            reference=self.reference,
            spring_foot=spring_foot,
        )

    def describe(self) -> dict[str, Any]:
        """Return the subject in JSON types, for result folders; it holds everything that changes a gait run."""
        return {
            "reference": self.reference.describe(),
            "mass_kg": self.mass,
            "stature_m": self.stature,
            "speed_m_per_s": self.speed,
            "slope_deg": self.slope_deg,
        }

    def format_sentence(self) -> str:
        """Return one sentence with body mass, stature and reference."""
        return (
            f"Subject: {self.mass:.4g} kg, {self.stature:.4g} m. Reference gait: {self.reference.name}, stride time "
            f"{self.reference.stride_time:.3f} s."
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Return a sentence for each implausible property of the reference that the user accepted."""
        return tuple(f"Accepted: {finding.sentence}." for finding in self.reference.accepted)


def resolve_subject(
    reference: ReferenceLike = None,
    *,
    stride_time: float | None = None,
    accept: Collection[str] = (),
    mass: float | None = None,
    stature: float | None = None,
    speed: float | None = None,
    slope: float = 0.0,
) -> Subject:
    """Return the subject of ``reference``; numbers that are None are those that the reference states.

    ``stride_time`` [s], ``mass`` [kg] and ``stature`` [m] override the reference; where neither gives a number it is
    that of the gait model. ``speed`` [m/s] scales the stride time, ``slope`` [deg] is that of the ground. ``accept``
    names findings about the file that are right although they look implausible.

    Raises InputError when the reference cannot be read or a number is out of range.
    """
    if stride_time is not None and reference is None:
        raise InputError("a stride time requires a reference file: the stride time of the default reference is fixed")
    gait = _resolve_reference(reference, stride_time, accept)
    return Subject(
        reference=gait,
        mass=_first_not_none(mass, gait.mass, MODEL_MASS),
        stature=_first_not_none(stature, gait.stature, MODEL_STATURE),
        speed=speed,
        slope_deg=slope,
    )


def _resolve_reference(reference: ReferenceLike, stride_time: float | None, accept: Collection[str]) -> Reference:
    if reference is None:
        return load_default_reference()
    if not isinstance(reference, Reference):
        return load_reference(reference, stride_time, accept)
    if stride_time is None:
        return reference
    check_stride_time(stride_time)
    return replace(reference, stride_time=stride_time)


def _first_not_none(*values: float | None) -> float:
    return next(value for value in values if value is not None)
