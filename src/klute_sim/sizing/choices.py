"""What a design is made from besides its target: what the user fixes, and what has to be assumed.

Lengths in m, forces in N, pressures in Pa (gauge), speeds in m/s.
"""

from dataclasses import dataclass, field, fields

from klute_sim.errors import InputError
from klute_sim.sizing.parts.limits import check_range
from klute_sim.units import BAR

ACTUATOR_LABELS = {"klute-1-1-4": "1-1/4 in", "klute-3-4": "3/4 in", "klute-1-2": "1/2 in"}
"""Presets of the actuators of Table 3.1, and what the table calls them."""
MAX_ACTUATORS = 100
"""As many as a device file may have."""
PA_PER_MPA = 1e6


@dataclass(frozen=True, kw_only=True)
class DesignAssumptions:
    """Numbers that the source does not print, or prints without saying that they are the design's."""

    design_ratio: float = 0.96
    """L/L0 at which F0 counts [1]: that of Fig. 3.9."""
    eccentric_speed_fraction: float = 0.5
    """Fastest lengthening over Vmax [1]: the tests of one actuator went to 150 of 300 mm/s."""
    cylinder_pressure: float = 4.7 * PA_PER_MPA
    """Gauge pressure in the damper under the designed force [Pa]: 20 mm of bore for the 3/4 in pair."""
    discharge_coefficient: float = 1.0
    """Cd that the orifices, sized with 1, turn out to have [1]; the source: in reality as low as 0.61."""
    neutral_ratio: float = 0.975
    """Muscle length over L0 with the ankle at neutral and the tendon just taut [1]."""
    excursion_fraction: float = 0.10
    """Most travel of the tendon's insertion over L0 [1]: 23.5 mm on the 250 mm of Fig. 3.8 are 0.094."""
    slack_length: float = 0.100
    """Of the tendon [m]."""
    tendon_strain: float = 0.040
    """Stretch at the design force over tendon plus muscle [1]: the Achilles tendon's peak in walking."""
    second_spring_ratio: float = 140.0 / 60.0
    """Slope that the tendon's second spring adds, over the first spring's [1]."""
    engagement_fraction: float = 0.05
    """Stretch at which the second spring joins, over the slack length [1]."""
    moment_arm: float = 0.048
    """Of the tendon about the ankle [m], the same at every angle: the Achilles tendon's at neutral."""
    pressure_rate: float = 50.0 * BAR
    """Of the regulator [Pa/s]."""
    gas_temperature: float = 20.0
    """Of the gas [degrees Celsius]."""

    def __post_init__(self) -> None:
        """Raise InputError for a number that no such device has."""
        check_range("design ratio L/L0", self.design_ratio, 0.8, 1.0, "")
        check_range("eccentric speed over Vmax", self.eccentric_speed_fraction, 0.01, 2.0, "")
        check_range("cylinder pressure", self.cylinder_pressure, 0.1, 70.0, "MPa", PA_PER_MPA)
        check_range("discharge coefficient", self.discharge_coefficient, 0.5, 1.0, "")
        check_range("neutral muscle ratio", self.neutral_ratio, 0.8, 1.0, "")
        check_range("excursion over resting length", self.excursion_fraction, 0.02, 0.25, "")
        check_range("tendon slack length", self.slack_length, 10.0, 400.0, "mm", 1e-3)
        check_range("tendon strain", self.tendon_strain, 0.5, 15.0, "%", 0.01)
        check_range("second spring over first", self.second_spring_ratio, 0.0, 20.0, "")
        check_range("engagement over slack length", self.engagement_fraction, 0.0, 0.5, "")
        check_range("moment arm", self.moment_arm, 10.0, 100.0, "mm", 1e-3)
        check_range("pressure rate", self.pressure_rate, 1.0, 1000.0, "bar/s", BAR)
        check_range("gas temperature", self.gas_temperature, -40.0, 80.0, "degrees C")


@dataclass(frozen=True, kw_only=True)
class DesignChoices:
    """What the user fixes; None: by rule."""

    supply_pressure: float = 5.0 * BAR
    """Highest gauge pressure [Pa]; Table 3.1 was fitted at 2 to 5 bar."""
    actuator: str | None = None
    """One of :data:`ROWS`."""
    count: int | None = None
    """Actuators in parallel."""
    resting_length: float | None = None
    """L0 [m]."""
    bore: float | None = None
    """Of the damper [m]."""
    eccentric_speed: float | None = None
    """Lengthening speed at which the damper is sized [m/s]."""
    eccentric_force: float | None = None
    """Damping there [N]."""
    oil_density: float = 900.0
    """Mineral oil (chapter 4) [kg/m3]."""
    assumptions: DesignAssumptions = field(default_factory=DesignAssumptions)
    explicit_fields: frozenset[str] = frozenset()
    """Fields of :class:`Assumptions`, and ``a`` and ``b`` of Hill's equation, that the user gave, at whatever value."""

    @property
    def fixed_fields(self) -> frozenset[str]:
        """What is no assumption any more: :attr:`named`, and every field that is not at its default."""
        default = DesignAssumptions()
        names = (f.name for f in fields(DesignAssumptions))
        return self.explicit_fields | {n for n in names if getattr(self.assumptions, n) != getattr(default, n)}

    def __post_init__(self) -> None:
        """Raise InputError for a choice that cannot be made."""
        if self.actuator is not None and self.actuator not in ACTUATOR_LABELS:
            raise InputError(f"there is no actuator '{self.actuator}'; there are: {', '.join(ACTUATOR_LABELS)}")
        limits = (
            ("supply pressure", self.supply_pressure, 2.0, 8.0, "bar", BAR),
            ("count of actuators", self.count, 1, MAX_ACTUATORS, "", 1.0),
            ("resting length", self.resting_length, 20.0, 2000.0, "mm", 1e-3),
            ("bore", self.bore, 1.0, 200.0, "mm", 1e-3),
            ("eccentric speed", self.eccentric_speed, 1.0, 5000.0, "mm/s", 1e-3),
            ("eccentric damping force", self.eccentric_force, 0.01, 1e5, "N", 1.0),
            ("oil density", self.oil_density, 500.0, 2000.0, "kg/m³", 1.0),
        )
        for name, value, low, high, unit, factor in limits:
            if value is not None:
                check_range(name, value, low, high, unit, factor)
