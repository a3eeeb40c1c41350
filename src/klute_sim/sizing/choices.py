"""Inputs of a design besides its target: the choices of the user and the assumptions.

Units: lengths in m, forces in N, gauge pressures in Pa, speeds in m/s.
"""

from dataclasses import dataclass, field, fields

from klute_sim.errors import InputError
from klute_sim.sizing.parts.limits import check_range
from klute_sim.units import BAR

ACTUATOR_LABELS = {"klute-1-1-4": "1-1/4 in", "klute-3-4": "3/4 in", "klute-1-2": "1/2 in"}
"""Presets of the actuators of Table 3.1 with their labels in that table."""
MAX_ACTUATORS = 100
"""Largest number of parallel actuators that a device file allows."""
PA_PER_MPA = 1e6
"""Pascals per megapascal."""


@dataclass(frozen=True, kw_only=True)
class DesignAssumptions:
    """Values that the source does not print, or does not identify as those of its design."""

    design_ratio: float = 0.96
    """Muscle length over resting length at which F0 is evaluated [1]; value of Fig. 3.9."""
    eccentric_speed_fraction: float = 0.5
    """Fastest lengthening speed over Vmax [1]; the tests of one actuator reached 150 of 300 mm/s."""
    cylinder_pressure: float = 4.7 * PA_PER_MPA
    """Gauge pressure in the damper at the design force [Pa]; gives the 3/4 in pair a bore of 20 mm."""
    discharge_coefficient: float = 1.0
    """Actual discharge coefficient Cd of orifices that were sized with 1 [1]; the source reports values down to
    0.61.
    """
    neutral_ratio: float = 0.975
    """Muscle length over L0 at the neutral ankle angle with a just taut tendon [1]."""
    excursion_fraction: float = 0.10
    """Largest travel of the tendon insertion over L0 [1]; Fig. 3.8 has 23.5 mm of 250 mm, which is 0.094."""
    slack_length: float = 0.100
    """Slack length of the tendon [m]."""
    tendon_strain: float = 0.040
    """Stretch at the design force over the length of tendon plus muscle [1]; peak strain of the Achilles tendon in
    walking.
    """
    second_spring_ratio: float = 140.0 / 60.0
    """Stiffness that the second tendon spring adds, over the stiffness of the first spring [1]."""
    engagement_fraction: float = 0.05
    """Stretch at which the second tendon spring engages, over the slack length [1]."""
    moment_arm: float = 0.048
    """Moment arm of the tendon about the ankle [m], equal at all angles; value of the Achilles tendon at neutral."""
    pressure_rate: float = 50.0 * BAR
    """Rate limit of the pressure regulator [Pa/s]."""
    gas_temperature: float = 20.0
    """Gas temperature [degrees Celsius]."""
    dead_volume: float = 2.5e-6
    """Air in fittings and hose per actuator, which the muscle does not displace [m3]; 20 cm of hose of 4 mm."""

    def __post_init__(self) -> None:
        """Raise InputError when a value is outside its physical range."""
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
        check_range("dead volume", self.dead_volume, 0.0, 1000.0, "cm³", 1e-6)


@dataclass(frozen=True, kw_only=True)
class DesignChoices:
    """Choices of the user; None selects the design rule."""

    supply_pressure: float = 5.0 * BAR
    """Highest supply gauge pressure [Pa]; Table 3.1 was fitted at 2 to 5 bar."""
    actuator: str | None = None
    """Actuator preset, one of :data:`ACTUATOR_LABELS`."""
    count: int | None = None
    """Number of parallel actuators."""
    resting_length: float | None = None
    """Resting length L0 of the actuators [m]."""
    bore: float | None = None
    """Bore of the damper [m]."""
    eccentric_speed: float | None = None
    """Lengthening speed of the eccentric design point [m/s]."""
    eccentric_force: float | None = None
    """Damping force of the eccentric design point [N]."""
    oil_density: float = 900.0
    """Density of the damper oil [kg/m3]; mineral oil in chapter 4."""
    assumptions: DesignAssumptions = field(default_factory=DesignAssumptions)
    """Values that the source does not give."""
    explicit_fields: frozenset[str] = frozenset()
    """Names that the user specified, whatever the value: fields of :class:`DesignAssumptions`, and ``a`` and ``b``
    of (2.4).
    """

    @property
    def fixed_fields(self) -> frozenset[str]:
        """Return the names that are not assumed: :attr:`explicit_fields` and all fields that differ from their
        defaults.
        """
        default = DesignAssumptions()
        names = (f.name for f in fields(DesignAssumptions))
        return self.explicit_fields | {n for n in names if getattr(self.assumptions, n) != getattr(default, n)}

    def __post_init__(self) -> None:
        """Raise InputError when a choice is unknown or outside its range."""
        if self.actuator is not None and self.actuator not in ACTUATOR_LABELS:
            raise InputError(f"unknown actuator '{self.actuator}'; allowed: {', '.join(ACTUATOR_LABELS)}")
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
