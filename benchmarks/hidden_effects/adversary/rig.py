"""Numbers of the rig: those of a device file, and departures from the textbook, each neutral by default."""

import tomllib
from collections.abc import Mapping
from typing import Any, NamedTuple

BAR = 1e5
ATMOSPHERE = 101325.0
"""Absolute ambient pressure [Pa]."""
NORMAL_DENSITY = 1.185
"""Density of air at 1 bar and 20 °C with a relative humidity of 65 % [kg/m³]: the reference of sonic conductances."""


class Rig(NamedTuple):
    """A unit of muscles, damper and tendon on a tester, with its air supply, in SI units."""

    count: float = 2.0
    resting_length: float = 0.25
    braid_length: float = 0.2632598
    turns: float = 2.0718232
    bladder_radius: float = 6.4e-3
    bladder_thickness: float = 1.6e-3
    c10: float = 118.4e3
    c01: float = 105.7e3
    friction_slope: float = 28.0e-5
    """Offset of the tension of one muscle over its pressure, Table 3.1 [N/Pa]."""
    friction_offset: float = -38.2
    """Offset of the tension of one muscle at zero pressure, Table 3.1 [N]."""
    bore: float = 20e-3
    orifice_concentric: float = 1.084e-3
    orifice_eccentric: float = 1.062e-3
    oil_density: float = 900.0
    slack_length: float = 0.1
    stiffness_1: float = 60e3
    stiffness_2: float = 140e3
    engagement: float = 5e-3
    supply_pressure: float = 5e5
    """Gauge pressure upstream of regulator or valve [Pa]."""
    pressure_rate: float = 100e5
    gas_temperature: float = 293.15
    dead_volume: float = 5e-6

    has_valve: bool = False
    """Whether a proportional valve with finite flow fills the muscle, instead of a regulator."""
    fill_conductance: float = 2e-8
    """Sonic conductance of the valve while filling [m³/(s Pa)]."""
    exhaust_conductance: float = 2e-8
    valve_gain: float = 5e-5
    """Opening per error of the pressure [1/Pa]."""
    heat_time: float = 0.3
    """Time constant with which the air takes the temperature of the wall [s]."""

    cone_slope: float = 0.0
    """Length of a conical end over the growth of the radius; 0: cylindrical ends."""
    creep_per_decade: float = 0.0
    """Share of the bladder's tension that relaxes in each decade of time."""
    braid_friction: float = 0.0
    """Friction of the braid of one muscle over its pressure, at a contraction of 10 % [N/Pa]."""
    braid_reach: float = 1e-3
    """Displacement over which the friction of the braid builds up [m]."""
    seal_friction: float = 0.0
    """Friction of the damper's seal without oil pressure [N]."""
    seal_reach: float = 0.1e-3
    viscous_clearance: float = 0.0
    """Viscous coefficient of the oil in the clearances of the damper [N s/m]."""
    rubber_damping: float = 0.0
    """Tension of both muscles at 0.1 m/s that grows with a power of the speed [N]."""
    toe_length: float = 0.0
    """Stretch over which the second spring of the tendon comes in [m]."""
    tendon_loss: float = 0.0
    """Half width of the tendon's hysteresis over its tension."""
    dead_stretch: float = 0.0
    """Stretch of the tendon's attachment before it pulls [m]."""
    threshold: float = 0.0
    """Pressure that inflates the bladder until it touches the braid, at rest length [Pa]."""
    thread_strain: float = 0.0
    """Strain of the braid's threads at 5 bar."""
    regulator_time: float = 0.0
    """Slower time constant of the regulator and its line [s]."""
    pilot_time: float = 0.0
    """Faster time constant of the regulator [s]."""
    flow_droop: float = 0.0
    """Fall of the regulated pressure over the flow of free air that the muscle draws [Pa s/m³]."""
    regulator_gain: float = 1.0
    hose_length: float = 0.0
    hose_diameter: float = 4e-3
    leak_conductance: float = 0.0
    """Sonic conductance from the muscle to the atmosphere [m³/(s Pa)]."""
    tank_volume: float = 0.0
    """Volume of a tank without refill [m³]; 0: a supply that holds its pressure."""


FILE_KEYS: Mapping[str, tuple[str, float]] = {
    "muscle.count": ("count", 1.0),
    "muscle.resting_length_mm": ("resting_length", 1e-3),
    "muscle.bladder_radius_mm": ("bladder_radius", 1e-3),
    "muscle.bladder_thickness_mm": ("bladder_thickness", 1e-3),
    "muscle.c10_kpa": ("c10", 1e3),
    "muscle.c01_kpa": ("c01", 1e3),
    "muscle.friction_slope_n_per_bar": ("friction_slope", 1e-5),
    "muscle.friction_offset_n": ("friction_offset", 1.0),
    "damper.bore_mm": ("bore", 1e-3),
    "damper.orifice_concentric_mm": ("orifice_concentric", 1e-3),
    "damper.orifice_eccentric_mm": ("orifice_eccentric", 1e-3),
    "damper.oil_density_kg_m3": ("oil_density", 1.0),
    "tendon.slack_length_mm": ("slack_length", 1e-3),
    "tendon.stiffness_1_n_per_mm": ("stiffness_1", 1e3),
    "tendon.stiffness_2_n_per_mm": ("stiffness_2", 1e3),
    "tendon.engagement_mm": ("engagement", 1e-3),
    "supply.pressure_bar": ("supply_pressure", BAR),
    "supply.rate_bar_per_s": ("pressure_rate", BAR),
    "supply.dead_volume_cm3": ("dead_volume", 1e-6),
    "valve.fill_dm3_per_s_bar": ("fill_conductance", 1e-8),
    "valve.exhaust_dm3_per_s_bar": ("exhaust_conductance", 1e-8),
    "valve.gain_per_bar": ("valve_gain", 1e-5),
    "chamber.thermal_time_constant_s": ("heat_time", 1.0),
}
"""Key of a device file -> field of the rig, and its unit in SI."""


def read_device_numbers(text: str) -> dict[str, float]:
    """Return the numbers of the ``text`` of a device file by ``section.key``, in the units of the file."""
    content: dict[str, Any] = tomllib.loads(text)
    return {
        f"{section}.{key}": float(value)
        for section, table in content.items()
        if isinstance(table, dict) and section != "sources"
        for key, value in table.items()
        if isinstance(value, int | float) and not isinstance(value, bool)
    }


def build_rig(numbers: Mapping[str, float], **departures: float) -> Rig:
    """Return the rig with the ``numbers`` of a device file (:func:`read_device_numbers`) and ``departures``.

    Braid length B and turns N of one muscle follow from their ratios to the resting length L0. Raises KeyError for a
    number that is missing.
    """
    fields = {field: numbers[key] * unit for key, (field, unit) in FILE_KEYS.items() if key in numbers}
    resting_length = 1e-3 * numbers["muscle.resting_length_mm"]
    fields["braid_length"] = numbers["muscle.braid_length_ratio"] * resting_length
    fields["turns"] = numbers["muscle.turns_per_m"] * resting_length
    fields["gas_temperature"] = 273.15 + numbers["supply.gas_temperature_c"]
    return Rig(has_valve="valve.gain_per_bar" in numbers)._replace(**fields, **departures)
