"""Criteria of whether a prosthesis serves a person: its gait beside the person's own ankle.

The limits are assumed. A prosthesis serves if its gait meets all of them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from klute_sim.gait.metrics import AnkleMetrics, GaitMetrics, StrideMetrics
from klute_sim.gait.reference import MAX_GRF_TRACKING_RMS_BW

MIN_TOE_CLEARANCE_MM = 10.0
"""Minimum toe clearance in mid-swing [mm] (assumed).

Able-bodied adults have a mean of 13 mm (Winter 1991, after Kirtley's teach-in of 1999) or 19 mm (Moosabhoy and Gard
2006, abstract).
"""


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """A quantity of gait and its limits, absolute or relative to the person's own ankle."""

    name: str
    """Name of the quantity in sentences."""
    title: str
    """Title of the column, with the unit in the second line."""
    unit: str
    """Unit in sentences."""
    format_spec: str
    """Format of the number."""
    get_value: Callable[[StrideMetrics], float | None]
    """Function that reads the quantity from one stride."""
    get_person_value: Callable[[AnkleMetrics], float] | None = None
    """Function that reads it from the person's own ankle; None: a person has no such quantity."""
    min_ratio: float | None = None
    """Minimum relative to the own value [1]; None: no limit."""
    max_ratio: float | None = None
    """Maximum relative to the own value [1]; None: no limit."""
    minimum: float | None = None
    """Minimum in the unit; None: no limit."""
    maximum: float | None = None
    """Maximum in the unit; None: no limit."""

    def describe(self) -> str:
        """Return the limits in words."""
        if self.get_person_value is not None:
            limits = [(self.min_ratio, "at least"), (self.max_ratio, "at most")]
            parts = [f"{word} {100.0 * ratio:.0f} %" for ratio, word in limits if ratio is not None]
            return f"{self.name}: {' and '.join(parts)} of the person's own, where that is positive"
        absolute = [(self.minimum, "at least"), (self.maximum, "at most")]
        parts = [f"{word} {limit:g} {self.unit}" for limit, word in absolute if limit is not None]
        return f"{self.name}: {' and '.join(parts)}"

    def find_shortfall(self, value: float | None, person_value: float | None) -> str | None:
        """Return one sentence if ``value`` misses a limit; None: it does not, or there is nothing to compare."""
        if value is None:
            return None
        number = f"{value:{self.format_spec}} {self.unit}"
        if person_value is not None:
            ratio = value / person_value if person_value > 0.0 else 1.0
            person_text = f"{person_value:{self.format_spec}} {self.unit} of the person's own ankle"
            if self.min_ratio is not None and ratio < self.min_ratio:
                return f"The {self.name} is {number}, {100.0 * ratio:.0f} % of the {person_text}."
            if self.max_ratio is not None and ratio > self.max_ratio:
                return f"The {self.name} is {number}, too much: {100.0 * ratio:.0f} % of the {person_text}."
            return None
        if self.minimum is not None and value < self.minimum:
            return f"The {self.name} is {number}, less than {self.minimum:g} {self.unit}."
        if self.maximum is not None and value > self.maximum:
            return f"The {self.name} is {number}, more than {self.maximum:g} {self.unit}."
        return None


CRITERIA = (
    Criterion(
        name="peak ankle moment",
        title="moment\nN·m/kg",
        unit="N·m/kg",
        format_spec=".2f",
        get_value=lambda s: s.ankle_moment_peak_nm_per_kg,
        get_person_value=lambda s: s.ankle_moment_peak_nm_per_kg,
        min_ratio=0.9,
        max_ratio=1.1,
    ),
    Criterion(
        name="peak ankle power",
        title="power\nW/kg",
        unit="W/kg",
        format_spec=".2f",
        get_value=lambda s: s.ankle_power_peak_w_per_kg,
        get_person_value=lambda s: s.ankle_power_peak_w_per_kg,
        min_ratio=0.9,
        max_ratio=1.25,
    ),
    Criterion(
        name="net ankle work of a stride",
        title="work\nJ/kg",
        unit="J/kg",
        format_spec="+.3f",
        get_value=lambda s: s.ankle_work_net_j_per_kg,
        get_person_value=lambda s: s.ankle_work_net_j_per_kg,
        min_ratio=0.9,
    ),
    Criterion(
        name="range of the ankle angle",
        title="range\ndeg",
        unit="deg",
        format_spec=".1f",
        get_value=lambda s: s.ankle_range_deg,
        get_person_value=lambda s: s.ankle_range_deg,
        min_ratio=0.75,
        max_ratio=1.25,
    ),
    Criterion(
        name="largest vertical load",
        title="load\nBW",
        unit="body weights",
        format_spec=".2f",
        get_value=lambda s: s.grf_vertical_max_bw,
        get_person_value=lambda s: s.grf_vertical_max_bw,
        max_ratio=1.25,
    ),
    Criterion(
        name="rms error of the vertical load",
        title="error\nBW",
        unit="body weights",
        format_spec=".3f",
        get_value=lambda s: s.grf_vertical_tracking_rms_bw,
        maximum=MAX_GRF_TRACKING_RMS_BW,
    ),
    Criterion(
        name="toe clearance in mid-swing",
        title="toe\nmm",
        unit="mm",
        format_spec=".1f",
        get_value=lambda s: s.toe_clearance_mm,
        minimum=MIN_TOE_CLEARANCE_MM,
    ),
    Criterion(
        name="part of the stride in which the supply pressure is below the command",
        title="supply\nshort %",
        unit="%",
        format_spec=".0f",
        get_value=lambda s: s.short_of_supply_pct,
        maximum=0.0,
    ),
)
"""Criteria in the order of the table; their limits are assumed."""


@dataclass(frozen=True)
class AssessedQuantity:
    """A quantity of a gait with the sentence on its shortfall."""

    criterion: Criterion
    """Quantity and limits."""
    value: float | None
    """Mean over the steady strides; None: unknown."""
    person_value: float | None
    """Value of the person's own ankle; None: it has no such quantity."""
    shortfall: str | None
    """Sentence on what is missing; None: the criterion is met."""


def assess_quantities(metrics: GaitMetrics, person_ankle: AnkleMetrics) -> list[AssessedQuantity]:
    """Return every quantity of :data:`CRITERIA` for the gait with ``metrics`` beside ``person_ankle``."""
    quantities = []
    for criterion in CRITERIA:
        value = metrics.mean(criterion.get_value)
        person_value = None if criterion.get_person_value is None else criterion.get_person_value(person_ankle)
        shortfall = criterion.find_shortfall(value, person_value)
        quantities.append(AssessedQuantity(criterion, value, person_value, shortfall))
    return quantities


def collect_shortfalls(metrics: GaitMetrics, quantities: Sequence[AssessedQuantity]) -> list[str]:
    """Return one sentence per shortfall; a foot that trips comes first."""
    trip = ["The foot touches the ground in swing: the person trips."] if metrics.has_swing_contact else []
    return trip + [quantity.shortfall for quantity in quantities if quantity.shortfall is not None]
