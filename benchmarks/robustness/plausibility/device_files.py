"""Device files with numbers in other units, and unusual but right ones."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from klute_sim.device.device import load_device, set_number
from klute_sim.errors import InputError
from klute_sim.files.toml import format_toml, parse_toml
from klute_sim.plausibility.finding import ImplausibleInputError


class DeviceVariant(NamedTuple):
    """A device file with changed numbers."""

    name: str
    """Description of the change."""
    expected: str
    """Name of the finding that must be reported; '' for a right file."""
    changes: dict[str, float]
    """Numbers that differ from those of the preset."""
    preset: str = "klute-1-1-4-pair-valve"
    """Preset before the change."""


def list_wrong() -> Iterator[DeviceVariant]:
    """Yield device files with one number in another unit, or of a magnitude that nothing has."""
    for key, value, unit in (
        ("muscle.c10_kpa", 118400.0, "Pa"),
        ("muscle.c10_kpa", 0.1184, "MPa"),
        ("muscle.c10_kpa", 1.184, "bar"),
        ("muscle.c01_kpa", 105700.0, "Pa"),
        ("muscle.c01_kpa", 0.1057, "MPa"),
        ("muscle.friction_slope_n_per_bar", 5.69e-4, "N/Pa"),
        ("muscle.friction_slope_n_per_bar", 569.0, "N/MPa"),
        ("muscle.friction_offset_n", 109800.0, "mN"),
        ("damper.oil_density_kg_m3", 0.9, "g/cm3"),
        ("damper.oil_density_kg_m3", 56.2, "lb/ft3"),
        ("tendon.stiffness_1_n_per_mm", 60000.0, "N/m"),
        ("tendon.stiffness_2_n_per_mm", 99000.0, "N/m"),
        ("tendon.slack_length_mm", 0.1, "m"),
        ("tendon.engagement_mm", 0.005, "m"),
        ("supply.rate_bar_per_s", 1e-300, "nothing"),
        ("supply.rate_bar_per_s", 5e6, "Pa/s"),
        ("supply.rate_bar_per_s", 5000.0, "kPa/s"),
        ("supply.gas_temperature_c", 193.0, "nothing"),
        ("supply.gas_temperature_c", 68.0, "degrees Fahrenheit"),
        ("supply.pressure_bar", 0.7, "MPa"),
        ("valve.fill_dm3_per_s_bar", 120.0, "l/(min*bar)"),
        ("valve.exhaust_dm3_per_s_bar", 120.0, "l/(min*bar)"),
        ("valve.gain_per_bar", 5e-5, "1/Pa"),
        ("line.length_m", 50.0, "cm"),
        ("line.inner_diameter_mm", 0.6, "cm"),
        ("supply.dead_volume_cm3", 0.005, "l"),
        ("supply.dead_volume_cm3", 5000.0, "mm3"),
        ("chamber.thermal_time_constant_s", 300.0, "ms"),
        ("tank.volume_l", 1500.0, "cm3"),
        ("tank.volume_l", 0.0015, "m3"),
        ("tank.pressure_bar", 2.0, "MPa"),
        ("tank.pressure_bar", 5.0, "MPa"),
        ("leak.conductance_dm3_per_s_bar", 1e-9, "m3/(s*Pa)"),
        ("muscle.resting_length_mm", 26.4, "cm"),
        ("muscle.resting_length_mm", 0.264, "m"),
        ("supply.pressure_bar", 700.0, "kPa"),
        ("supply.gas_temperature_c", 293.0, "K"),
        ("tank.pressure_bar", 20000.0, "kPa"),
    ):
        yield DeviceVariant(f"{key} = {value:g} ({unit})", key, {key: value})
    yield DeviceVariant("bore in m", "damper.bore_mm", _scale_damper(1e-3))
    yield DeviceVariant("bore in in", "damper.bore_mm", _scale_damper(1.0 / 25.4))
    yield DeviceVariant("bore in um", "damper.bore_mm", _scale_damper(1e3))


def _scale_damper(factor: float) -> dict[str, float]:
    """Return the diameters of the damper in another unit; they must fit together."""
    diameters = {"bore_mm": 27.0, "orifice_concentric_mm": 1.461, "orifice_eccentric_mm": 1.396}
    return {f"damper.{key}": value * factor for key, value in diameters.items()}


def list_right() -> Iterator[DeviceVariant]:
    """Yield unusual but right device files."""
    for changes in (
        {},
        {"muscle.c10_kpa": 15.0, "muscle.c01_kpa": 2.0},
        {"muscle.c10_kpa": 2000.0, "muscle.c01_kpa": 0.0},
        {"muscle.friction_slope_n_per_bar": 0.0, "muscle.friction_offset_n": 0.0},
        {"muscle.friction_slope_n_per_bar": -3.0, "muscle.friction_offset_n": -20.0},
        {"muscle.count": 24},
        {"damper.oil_density_kg_m3": 1800.0},
        {"tendon.stiffness_1_n_per_mm": 5000.0, "tendon.stiffness_2_n_per_mm": 0.0},
        {"tendon.stiffness_1_n_per_mm": 2.0},
        {"tendon.slack_length_mm": 0.0, "tendon.engagement_mm": 0.0},
        {"tendon.slack_length_mm": 600.0},
        {"supply.pressure_bar": 1.0},
        {"supply.pressure_bar": 12.0, "supply.rate_bar_per_s": 2000.0},
        {"supply.rate_bar_per_s": 0.2},
        {"supply.gas_temperature_c": -15.0},
        {"supply.gas_temperature_c": 45.0},
        {"valve.fill_dm3_per_s_bar": 0.02, "valve.exhaust_dm3_per_s_bar": 0.05, "valve.gain_per_bar": 100.0},
        {"valve.fill_critical_ratio": 0.0},
        {"line.length_m": 15.0, "line.inner_diameter_mm": 2.0},
        {"supply.dead_volume_cm3": 0.0, "chamber.thermal_time_constant_s": 0.0},
        {"tank.volume_l": 50.0, "tank.pressure_bar": 12.0},
        {"leak.conductance_dm3_per_s_bar": 0.0},
        {"leak.conductance_dm3_per_s_bar": 0.5},
    ):
        name = ", ".join(f"{key} = {value:g}" for key, value in changes.items()) or "the preset as a file"
        yield DeviceVariant(name, "", changes)


def find_names(variant: DeviceVariant, folder: Path) -> tuple[tuple[str, ...], str]:
    """Return the names of what is found in ``variant``, and the message; both are empty where it is accepted.

    A number beyond the limits of the format counts as found, because its message names it.
    """
    folder.mkdir(parents=True)
    try:
        load_device(write_device(variant, folder / "device.toml"))
    except ImplausibleInputError as error:
        return tuple(finding.name for finding in error.findings), str(error)
    except InputError as error:
        return tuple(key for key in variant.changes if f"{key} = " in str(error)), str(error)
    return (), ""


def write_device(variant: DeviceVariant, file: Path) -> Path:
    """Write the device file of ``variant``; return its path."""
    preset = load_device(variant.preset)
    content = parse_toml(preset.content, variant.preset)
    for key, value in variant.changes.items():
        set_number(content, key, value, "changed")
    file.write_text(format_toml(content), "utf-8")
    return file
