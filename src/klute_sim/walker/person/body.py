"""Muscles, nerves and amputation of the walker, read from ``body.toml``."""

import hashlib
import math
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from klute_sim.errors import InputError
from klute_sim.files.toml import parse_toml, validation_sentence
from klute_sim.plant.models import get_models_folder
from klute_sim.types import Array

MUSCLES = ("glutei", "hip_flexors", "hamstrings", "vasti", "gastrocnemius", "soleus", "tibialis_anterior")
"""Muscles of a leg, in the order of all arrays."""
CALF_MUSCLES = ("gastrocnemius", "soleus", "tibialis_anterior")
"""Muscles that a transtibial amputation removes."""
JOINTS = ("hip", "knee", "ankle")
"""Joints of a leg, in the order of all arrays."""
SIDES = ("left", "right")
"""Legs, in the order of all arrays; a prosthesis is on the right."""
BODY_FILE, SEGMENT_FILE = "body.toml", "walker.xml"
"""Files that define the body."""
CONTACT_CLASSES = ("sole", "ground")
"""Classes of the geoms of :data:`SEGMENT_FILE` that touch; the others are shapes to look at."""
LOOK_ELEMENTS, LOOK_ATTRIBUTES = (
    ("asset", "camera", "keyframe", "light", "statistic", "visual"),
    ("group", "material", "rgba"),
)
"""Elements and attributes of :data:`SEGMENT_FILE` that only change its looks."""

Positive = Annotated[FiniteFloat, Field(gt=0)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class JointPath(_Section):
    """How a muscle crosses a joint."""

    arm_m: FiniteFloat
    """Largest moment arm [m]; positive where flexion or dorsiflexion lengthens the muscle."""
    reference_deg: FiniteFloat
    """Joint angle at which the muscle has its reference length [deg]."""
    max_arm_deg: FiniteFloat | None = None
    """Joint angle of the largest arm [deg]; None: the arm is constant."""


class MuscleSection(_Section):
    """Numbers of one muscle as published."""

    max_force_n: Positive
    """Largest isometric force [N]."""
    max_velocity_lopt_per_s: Positive
    """Largest shortening velocity [l_opt/s]."""
    optimal_length_m: Positive
    """Optimal fiber length before the division by rho [m]."""
    slack_length_m: Positive
    """Slack length of the tendon before the division by rho [m]."""
    rho: Annotated[FiniteFloat, Field(gt=0, le=1)]
    """Published factor between the motion of the joint and that of the muscle [1]."""
    slow_fraction: Annotated[FiniteFloat, Field(ge=0, le=1)]
    """Share of slow fibers [1]."""
    hip: JointPath | None = None
    """Path over the hip; None: it does not cross it."""
    knee: JointPath | None = None
    """Path over the knee; None: it does not cross it."""
    ankle: JointPath | None = None
    """Path over the ankle; None: it does not cross it."""


class NervesSection(_Section):
    """Delays and thresholds of the reflexes."""

    activation_time_constant_ms: Positive
    """Time constant from stimulation to activation [ms]."""
    hip_delay_ms: Positive
    """Delay of the loops of hip and trunk [ms]."""
    knee_delay_ms: Positive
    """Delay of the loops of the knee [ms]."""
    ankle_delay_ms: Positive
    """Delay of the loops of the ankle [ms]."""
    stance_on_bw: Positive
    """Load of a leg above which it is in stance [body weights]."""
    stance_off_bw: Positive
    """Load of a leg below which it is in swing [body weights]."""


class AmputationSection(_Section):
    """Residual limb with socket, which replaces shank and foot."""

    residual_limb_mass_kg: Positive
    """Mass [kg]."""
    residual_limb_inertia_kg_m2: Positive
    """Moment of inertia about its centre of mass [kg*m2]."""
    residual_limb_com_m: Positive
    """Distance of its centre of mass below the knee [m]."""


class _MuscleSections(_Section):
    glutei: MuscleSection
    hip_flexors: MuscleSection
    hamstrings: MuscleSection
    vasti: MuscleSection
    gastrocnemius: MuscleSection
    soleus: MuscleSection
    tibialis_anterior: MuscleSection


class BodyDocument(_Section):
    """Content of the body file."""

    format: str
    """Format of the file."""
    muscles: _MuscleSections
    """Muscles of a leg; both legs are equal."""
    nerves: NervesSection
    """Delays and thresholds."""
    amputation: AmputationSection
    """Residual limb."""
    sources: dict[str, str]
    """Source by key; the keys of muscles are those of a muscle."""


@dataclass(frozen=True)
class Body:
    """The walker's muscles and nerves in SI units, ready for the time step."""

    document: BodyDocument
    """Numbers of the file."""
    digest: str
    """SHA-256 of all numbers of the body: gains belong to one body."""

    @property
    def muscle_rows(self) -> Array:
        """Numbers (muscles, 17) in the order of :class:`~klute_sim.walker.person.muscles.MuscleRow`."""
        return np.array([_to_row(getattr(self.document.muscles, name)) for name in MUSCLES])


def _to_row(muscle: MuscleSection) -> list[float]:
    row = [
        muscle.max_force_n,
        muscle.max_velocity_lopt_per_s,
        muscle.optimal_length_m / muscle.rho,
        muscle.slack_length_m / muscle.rho,
        muscle.slow_fraction,
    ]
    for path in (muscle.hip, muscle.knee, muscle.ankle):
        if path is None:
            row += [0.0, 0.0, 0.0, 0.0]
            continue
        reference, max_arm = math.radians(path.reference_deg), math.radians(path.max_arm_deg or 0.0)
        row += [path.arm_m, reference, max_arm, 0.0 if path.max_arm_deg is None else 1.0]
    return row


@cache
def load_body() -> Body:
    """Return the body of the package.

    Raises InputError when a number is missing or out of range.
    """
    content = (resources.files("klute_sim.walker.person") / BODY_FILE).read_bytes()
    try:
        document = BodyDocument.model_validate(parse_toml(content, BODY_FILE))
    except ValidationError as error:
        raise InputError(f"{BODY_FILE}: {validation_sentence(error, BodyDocument)}") from None
    return Body(document, _hash_numbers(document, (get_models_folder() / SEGMENT_FILE).read_text("utf-8")))


def _hash_numbers(document: BodyDocument, segments: str) -> str:
    """Return the SHA-256 of everything that moves the body: without sources, comments, blanks and looks.

    The height of the floor is one of the looks of the file; in a built model it is always 0.
    """
    numbers = document.model_dump_json(exclude={"sources"})
    root = ElementTree.fromstring(segments)
    for element in root.iter():
        for child in list(element):
            is_shape = element.tag != "default" and child.tag == "geom" and child.get("class") not in CONTACT_CLASSES
            if child.tag in LOOK_ELEMENTS or is_shape:
                element.remove(child)
        for attribute in LOOK_ATTRIBUTES:
            element.attrib.pop(attribute, None)
        if element.get("name") == "floor":
            element.attrib.pop("pos", None)
    elements = ElementTree.canonicalize(ElementTree.tostring(root, "unicode"), strip_text=True)
    return hashlib.sha256(f"{numbers}{elements}".encode()).hexdigest()
