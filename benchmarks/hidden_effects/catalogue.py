"""Effects that can be hidden in a dataset: names, forms, parameters, and their entry into the law.

Names, units, ranges and typical sizes of ``EFFECTS`` equal those of the public catalogue. ``OTHER_FORMS`` are
functional forms that are in no catalogue. ``neutral`` is the value without effect, or ``None`` for a parameter that
only shapes an effect (a time constant, a reach).
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.hidden_effects.air import GAS_CONSTANT, REFERENCE_DENSITY_FACTOR, AirSupply, is_coupled_to_motion
from benchmarks.hidden_effects.damper import compare_oil
from benchmarks.hidden_effects.law import Law

PRESET_FILE = Path(__file__).parents[2] / "src" / "klute_sim" / "device" / "presets" / "klute-3-4-pair.toml"
BAR = 1e5


class HiddenParameter(NamedTuple):
    """One parameter of an effect, in the unit of its name."""

    low: float
    high: float
    typical: float
    neutral: float | None = 0.0
    is_signed: bool = False
    """Whether the parameter may deviate from neutral in both directions."""


Forms = dict[tuple[str, str], dict[str, HiddenParameter]]

EFFECTS: Forms = {
    ("braid_hysteresis", "coulomb"): {"slope_n_per_bar": HiddenParameter(0, 60, 8)},
    ("braid_hysteresis", "maxwell_slip"): {
        "slope_n_per_bar": HiddenParameter(0, 60, 8),
        "stiffness_n_per_mm": HiddenParameter(1, 500, 40, None),
    },
    ("muscle_damping", "viscous"): {"coefficient_n_s_per_m": HiddenParameter(0, 3000, 150)},
    ("muscle_damping", "pressure"): {"coefficient_n_s_per_m": HiddenParameter(0, 1000, 40)},
    ("threshold_pressure", "constant"): {"pressure_bar": HiddenParameter(0, 3, 0.5)},
    ("threshold_pressure", "rising"): {
        "pressure_bar": HiddenParameter(0, 3, 0.5),
        "rise_bar": HiddenParameter(0, 60, 10),
    },
    ("end_taper", "cone"): {"cone_ratio": HiddenParameter(0, 5, 1)},
    ("end_taper", "strain"): {"factor": HiddenParameter(0, 5, 1)},
    ("bladder_relaxation", "maxwell"): {
        "stiffness_n_per_mm": HiddenParameter(0, 50, 3),
        "time_constant_s": HiddenParameter(0.02, 100, 1, None),
    },
    ("pressure_lag", "first_order"): {"time_constant_s": HiddenParameter(0, 0.5, 0.05)},
    ("pressure_delay", "dead_time"): {"delay_s": HiddenParameter(0, 0.3, 0.04)},
    ("regulator_error", "gain"): {"gain": HiddenParameter(0.7, 1.3, 0.95, 1.0, True)},
    ("regulator_error", "offset"): {"offset_bar": HiddenParameter(-0.5, 0.5, 0.1, 0.0, True)},
    ("seal_friction", "coulomb"): {"force_n": HiddenParameter(0, 200, 15)},
    ("laminar_orifice", "smooth"): {"transition_speed_mm_per_s": HiddenParameter(0, 500, 40)},
    ("discharge_loss", "constant"): {"discharge_coefficient": HiddenParameter(0.4, 1, 0.7, 1.0)},
    ("tendon_hysteresis", "slip"): {"loss_fraction": HiddenParameter(0, 0.5, 0.05)},
    ("tendon_hysteresis", "maxwell"): {
        "stiffness_n_per_mm": HiddenParameter(0, 200, 10),
        "time_constant_s": HiddenParameter(0.01, 10, 0.3, None),
    },
    ("tendon_slack", "dead_length"): {"slack_mm": HiddenParameter(0, 20, 1.5)},
    ("braid_hysteresis", "dahl"): {
        "slope_n_per_bar": HiddenParameter(0, 60, 8),
        "stiffness_n_per_mm": HiddenParameter(1, 500, 40, None),
    },
    ("braid_hysteresis", "bouc_wen"): {
        "slope_n_per_bar": HiddenParameter(0, 60, 8),
        "stiffness_n_per_mm": HiddenParameter(1, 500, 40, None),
        "gamma_over_beta": HiddenParameter(0.1, 1, 0.8, None),
    },
    ("braid_extensibility", "linear"): {"strain_per_bar": HiddenParameter(0, 0.03, 0.003)},
    ("thick_wall_bladder", "mooney_rivlin"): {"share": HiddenParameter(0, 3, 1)},
    ("bladder_softening", "ogden_roxburgh"): {
        "share": HiddenParameter(0, 0.9, 0.3),
        "energy_density_kpa": HiddenParameter(0.1, 1000, 10, None),
    },
    ("seal_friction", "stribeck"): {
        "force_n": HiddenParameter(0, 200, 15),
        "stick_fraction": HiddenParameter(0.05, 3, 0.6, None),
        "stribeck_speed_mm_per_s": HiddenParameter(1, 200, 15, None),
    },
    ("seal_friction", "pressure"): {
        "force_n": HiddenParameter(0, 200, 8),
        "growth_per_bar": HiddenParameter(0.01, 5, 0.3, None),
        "stiffness_n_per_mm": HiddenParameter(1, 1000, 50, None),
    },
    ("trapped_air", "isothermal"): {"air_volume_cm3": HiddenParameter(0, 10, 1)},
    ("rod_side_area", "single_rod"): {"rod_diameter_mm": HiddenParameter(0, 18, 8)},
    ("cavitation", "charge"): {"inverse_charge_per_bar": HiddenParameter(0, 1, 0.3)},
    ("oil_temperature", "walther"): {
        "temperature_c": HiddenParameter(-10, 80, 5, 20.0),
        "transition_speed_mm_per_s": HiddenParameter(1, 500, 40, None),
    },
    ("tendon_stiffening", "quadratic"): {"stiffening_n_per_mm2": HiddenParameter(0, 100, 2)},
    ("choked_valve", "symmetric"): {
        "resistance_s_bar_per_dm3": HiddenParameter(0, 50, 4),
        "critical_ratio": HiddenParameter(0.1, 0.6, 0.5, None),
    },
    ("choked_valve", "asymmetric"): {
        "fill_resistance_s_bar_per_dm3": HiddenParameter(0, 50, 4),
        "exhaust_factor": HiddenParameter(0.1, 10, 2, None),
        "critical_ratio": HiddenParameter(0.1, 0.6, 0.5, None),
    },
    ("hose", "tube"): {
        "length_m": HiddenParameter(0, 20, 2),
        "inner_diameter_mm": HiddenParameter(1, 20, 4, None),
    },
    ("volume_coupling", "polytropic"): {
        "recovery_s": HiddenParameter(0, 5, 0.05),
        "exponent": HiddenParameter(1, 1.4, 1.2, None),
    },
    ("leak", "orifice"): {"conductance_dm3_per_s_bar": HiddenParameter(0, 1, 0.02)},
    ("supply_droop", "tank"): {"inverse_volume_per_l": HiddenParameter(0, 20, 4)},
    ("end_taper", "length"): {"diameters": HiddenParameter(0, 10, 2)},
    ("end_taper", "contraction"): {
        "factor": HiddenParameter(0.5, 3, 1.25, 1.0),
        "low_pressure_factor": HiddenParameter(0, 20, 4),
    },
    ("passive_tension", "exponential"): {
        "rise_n": HiddenParameter(0, 3000, 150),
        "offset_n": HiddenParameter(0, 500, 25),
        "contraction_scale": HiddenParameter(0.002, 0.3, 0.037, None),
    },
    ("passive_tension", "power"): {
        "rise_n": HiddenParameter(0, 10000, 550),
        "offset_n": HiddenParameter(0, 500, 25),
    },
}

BODY_EFFECTS: Forms = {
    ("ankle_friction", "coulomb"): {"moment_n_m": HiddenParameter(0, 15, 2)},
    ("ankle_friction", "viscous"): {"damping_n_m_s": HiddenParameter(0, 10, 1)},
    ("return_spring_error", "stiffness"): {"gain": HiddenParameter(0.3, 3, 1.1, 1.0, True)},
    ("return_spring_error", "rest"): {"shift_deg": HiddenParameter(-15, 15, 1, 0.0, True)},
    ("end_stop", "bumper"): {
        "stiffness_n_m_per_deg": HiddenParameter(0, 100, 4),
        "begin_deg": HiddenParameter(1, 25, 7, None),
    },
    ("moment_arm_error", "insertion"): {"gain": HiddenParameter(0.7, 1.4, 1.05, 1.0, True)},
    ("inertia_error", "mass"): {"gain": HiddenParameter(0.4, 3, 1.4, 1.0, True)},
    ("foot_stiffness", "linear"): {"compliance_deg_per_n_m": HiddenParameter(0, 0.5, 0.05)},
    ("foot_hysteresis", "viscous"): {
        "compliance_deg_per_n_m": HiddenParameter(0, 0.5, 0.05),
        "time_constant_s": HiddenParameter(0.002, 2, 0.03, None),
    },
    ("foot_hysteresis", "coulomb"): {
        "compliance_deg_per_n_m": HiddenParameter(0, 0.5, 0.05),
        "moment_n_m": HiddenParameter(0.1, 30, 3, None),
    },
    ("socket_pistoning", "axial"): {"compliance_mm_per_kn": HiddenParameter(0, 60, 10)},
}
"""Effects of foot, ankle and socket, which show in gait."""

HOSE_FRICTION = 0.02
"""Friction factor of a hose after Darcy, as long smooth tubes have in turbulent flow."""
VALVE_EFFECTS = {"leak"}
"""Effects that a regulator compensates; they are hidden in a device with a known valve."""
KNOWN_VALVE: dict[str, Any] = {
    "name": "choked_valve",
    "form": "symmetric",
    "parameters": {"resistance_s_bar_per_dm3": 4.0, "critical_ratio": 0.5},
}

OTHER_FORMS: Forms = {
    # Friction that grows with the contact between the threads, which turn into each other as the muscle contracts.
    ("braid_hysteresis", "contact_area"): {
        "slope_n_per_bar": HiddenParameter(0, 60, 8),
        "growth": HiddenParameter(3, 30, 10, None),
        "reach_mm": HiddenParameter(0.05, 5, 0.5, None),
    },
    ("muscle_damping", "power_1_5"): {"coefficient": HiddenParameter(0, 6000, 400)},
    ("pressure_lag", "second_order"): {
        "natural_rad_per_s": HiddenParameter(15, 120, 40, math.inf),
        "damping_ratio": HiddenParameter(0.4, 1.2, 0.7, None),
    },
    ("seal_friction", "lugre"): {
        "force_n": HiddenParameter(0, 60, 15),
        "rise": HiddenParameter(0, 0.4, 0.3, None),
        "speed_mm_per_s": HiddenParameter(30, 100, 50, None),
        "reach_mm": HiddenParameter(0.05, 2, 0.3, None),
    },
    ("tendon_slack", "toe"): {"toe_mm": HiddenParameter(0, 10, 4)},
    ("braid_hysteresis", "prandtl_ishlinskii"): {
        "slope_n_per_bar": HiddenParameter(0, 60, 8),
        "reach_mm": HiddenParameter(0.2, 20, 3, None),
    },
    ("bladder_relaxation", "log_time"): {"stiffness_n_per_mm": HiddenParameter(0, 20, 1)},
    ("muscle_damping", "warming"): {
        "coefficient_n_s_per_m": HiddenParameter(0, 3000, 300),
        "loss_per_j": HiddenParameter(0.001, 0.1, 0.01, None),
    },
    ("end_taper", "quadratic"): {"factor": HiddenParameter(0, 40, 8)},
    ("leak", "crack"): {"conductance_dm3_per_s_bar": HiddenParameter(0, 1, 0.03)},
}


class Channel(NamedTuple):
    """A measured channel: unit, RMS noise, and typical faults of its instrument in that unit."""

    unit: str
    noise: float
    gain: float
    offset: float
    drift: float
    display_step: float


BENCH_CHANNELS = {
    "force": Channel("N", 3.0, 0.96, 15.0, 4.0, 12.0),
    "pressure": Channel("bar", 0.01, 0.96, 0.08, 0.02, 0.04),
    "muscle_length": Channel("mm", 0.02, 0.997, 0.3, 0.08, 0.08),
}


GAIT_CHANNELS = {
    "ankle_angle": Channel("deg", 0.1, 0.96, 1.0, 0.3, 0.3),
    "force": Channel("N", 5.0, 0.96, 15.0, 4.0, 12.0),
    "pressure": Channel("bar", 0.01, 0.96, 0.08, 0.02, 0.04),
    "muscle_length": Channel("mm", 0.05, 0.997, 0.3, 0.08, 0.08),
}


def instrument_forms(channel: str) -> Forms:
    """Return the instrument faults of ``channel``; offsets, drifts and steps are in its unit."""
    _, _, gain, offset, drift, step = {**GAIT_CHANNELS, **BENCH_CHANNELS}[channel]
    return {
        ("sensor_gain", "gain"): {"gain": HiddenParameter(0.8, 1.2, gain, 1.0, True)},
        ("sensor_offset", "offset"): {"offset": HiddenParameter(-10 * offset, 10 * offset, offset, 0.0, True)},
        ("sensor_drift", "linear"): {"drift_per_s": HiddenParameter(-10 * drift, 10 * drift, drift, 0.0, True)},
        ("sensor_lag", "first_order"): {"time_constant_s": HiddenParameter(0, 0.2, 0.02)},
        ("clock_skew", "shift"): {"shift_s": HiddenParameter(0, 0.1, 0.015)},
        ("quantisation", "linear"): {"step": HiddenParameter(0, 10 * step, step)},
    }


RELATIVE_UNCERTAINTIES: dict[str, float] = {
    "muscle.c10_kpa": 0.10,
    "muscle.friction_slope_n_per_bar": 0.10,
    "tendon.stiffness_1_n_per_mm": 0.10,
    "tendon.stiffness_2_n_per_mm": 0.10,
    "tendon.slack_length_mm": 0.01,
    "damper.orifice_concentric_mm": 0.03,
    "damper.orifice_eccentric_mm": 0.03,
}


def load_device(path: Path = PRESET_FILE) -> dict[str, float]:
    """Return the numbers of a device file as ``table.key`` in the units of the keys."""
    document = tomllib.loads(path.read_text("utf-8"))
    non_numeric = {"sources", "effects"}
    tables = {name: table for name, table in document.items() if isinstance(table, dict) and name not in non_numeric}
    return {f"{name}.{key}": float(value) for name, table in tables.items() for key, value in table.items()}


def build_neutral_law(device: Mapping[str, float]) -> tuple[Law, AirSupply]:
    """Return the device without hidden effects in SI units."""

    def get_si(key: str, factor: float = 1.0) -> float:
        return device[key] * factor

    resting_length = get_si("muscle.resting_length_mm", 1e-3)
    turns = get_si("muscle.turns_per_m") * resting_length
    outer = get_si("muscle.bladder_radius_mm", 1e-3)
    inner = outer - get_si("muscle.bladder_thickness_mm", 1e-3)
    bore, density = get_si("damper.bore_mm", 1e-3), get_si("damper.oil_density_kg_m3")

    def orifice(key: str) -> float:  # inverse of (4.6) with a discharge coefficient of 1
        ratio = bore / get_si(key, 1e-3)
        return math.pi * bore**2 / 4 * density / 2 * (ratio**4 - 1.0)

    law = Law(
        n_muscles=get_si("muscle.count"),
        resting_length=resting_length,
        braid_length=get_si("muscle.braid_length_ratio") * resting_length,
        turns=turns,
        bladder_gain=math.pi * (outer**2 - inner**2),
        hoop_factor=(resting_length / (2 * math.pi * turns * outer)) ** 2,
        outer_radius=outer,
        inner_radius=inner,
        c10=get_si("muscle.c10_kpa", 1e3),
        c01=get_si("muscle.c01_kpa", 1e3),
        friction_slope=get_si("muscle.friction_slope_n_per_bar", 1 / BAR),
        friction_offset=get_si("muscle.friction_offset_n"),
        damping_in=orifice("damper.orifice_concentric_mm"),
        damping_out=orifice("damper.orifice_eccentric_mm"),
        bore_area=math.pi * bore**2 / 4,
        slack=get_si("tendon.slack_length_mm", 1e-3),
        stiffness_1=get_si("tendon.stiffness_1_n_per_mm", 1e3),
        stiffness_2=get_si("tendon.stiffness_2_n_per_mm", 1e3),
        engagement=get_si("tendon.engagement_mm", 1e-3),
        **dict.fromkeys(Law._fields[Law._fields.index("coulomb_slope") :], 0.0),
    )
    divisors = ("slip_stiffness", "hysteretic_stiffness", "softening_energy", "relax_time", "stribeck_speed")
    divisors += ("tendon_time", "contact_reach", "play_reach", "lugre_speed", "lugre_reach")
    law = law._replace(middle_contraction=1.0, **dict.fromkeys(divisors, 1.0))
    air = AirSupply(
        supply_pressure=get_si("supply.pressure_bar", BAR),
        max_rate=get_si("supply.rate_bar_per_s", BAR),
        **dict.fromkeys(AirSupply._fields[2:], 0.0),
    )
    temperature = device["supply.gas_temperature_c"] + 273.15
    air = air._replace(gain=1.0, damping_ratio=1.0, temperature=temperature, exponent=1.0)
    air = air._replace(dead_volume=get_si("supply.dead_volume_cm3", 1e-6))
    return law, air


def add_effects(law: Law, air: AirSupply, effects: Sequence[Mapping[str, Any]]) -> tuple[Law, AirSupply]:
    """Return the device with ``effects``, each ``{"name", "form", "parameters"}``."""
    for effect in effects:
        key, p = (effect["name"], effect["form"]), effect["parameters"]
        expected = {**EFFECTS, **OTHER_FORMS}.get(key)
        if expected is None:
            raise ValueError(f"no effect {key[0]!r} with form {key[1]!r}")
        if set(p) != set(expected):
            raise ValueError(f"{key[0]}/{key[1]} takes {sorted(expected)}, not {sorted(p)}")
        for name, value in p.items():
            if not expected[name].low <= value <= expected[name].high and value != expected[name].neutral:
                raise ValueError(f"{key[0]}/{key[1]}: {name} = {value} outside its range")
        law, air = _apply_effect(law, air, key, p)
    if air.fill_conductance > 0.0:  # behind a valve, no regulator compensates the motion
        air = air._replace(recovery_time=0.0, exponent=1.0)
    if is_coupled_to_motion(air) and air.natural_frequency > 0.0:
        raise ValueError("second-order dynamics are for a pressure that does not depend on the motion")
    # Floats only: an integer type would recompile the compiled functions.
    return Law(*map(float, law)), AirSupply(*map(float, air))


def _apply_effect(
    law: Law, air: AirSupply, key: tuple[str, str], parameters: Mapping[str, float]
) -> tuple[Law, AirSupply]:
    match key:
        case ("braid_hysteresis", "coulomb"):
            law = law._replace(coulomb_slope=parameters["slope_n_per_bar"] / BAR)
        case ("braid_hysteresis", "maxwell_slip"):
            stiffness = parameters["stiffness_n_per_mm"] * 1e3
            law = law._replace(slip_slope=parameters["slope_n_per_bar"] / BAR, slip_stiffness=stiffness)
        case ("braid_hysteresis", "contact_area"):
            slope, reach = parameters["slope_n_per_bar"] / BAR, parameters["reach_mm"] * 1e-3
            law = law._replace(contact_slope=slope, contact_growth=parameters["growth"], contact_reach=reach)
        case ("muscle_damping", "viscous"):
            law = law._replace(viscous=parameters["coefficient_n_s_per_m"])
        case ("muscle_damping", "pressure"):
            law = law._replace(viscous_pressure=parameters["coefficient_n_s_per_m"] / BAR)
        case ("muscle_damping", "power_1_5"):
            law = law._replace(power=parameters["coefficient"])
        case ("threshold_pressure", _):
            law = law._replace(
                threshold=parameters["pressure_bar"] * BAR, threshold_rise=parameters.get("rise_bar", 0.0) * BAR
            )
        case ("end_taper", "cone"):
            law = law._replace(cone_slope=parameters["cone_ratio"])
        case ("end_taper", "strain"):
            law = law._replace(taper=parameters["factor"])
        case ("end_taper", "length"):
            law = law._replace(end_diameters=parameters["diameters"])
        case ("end_taper", "contraction"):
            law = law._replace(middle_contraction=parameters["factor"], middle_excess=parameters["low_pressure_factor"])
        case ("passive_tension", _):
            law = law._replace(
                passive_offset=parameters["offset_n"],
                passive_rise=parameters["rise_n"],
                passive_scale=parameters.get("contraction_scale", 0.0),
            )
        case ("bladder_relaxation", "maxwell"):
            law = law._replace(
                relax_stiffness=parameters["stiffness_n_per_mm"] * 1e3, relax_time=parameters["time_constant_s"]
            )
        case ("pressure_lag", "first_order"):
            air = air._replace(lag_time=parameters["time_constant_s"])
        case ("pressure_lag", "second_order"):
            natural = parameters["natural_rad_per_s"]
            air = air._replace(
                natural_frequency=natural if math.isfinite(natural) else 0.0, damping_ratio=parameters["damping_ratio"]
            )
        case ("pressure_delay", "dead_time"):
            air = air._replace(dead_time=air.dead_time + parameters["delay_s"])
        case ("regulator_error", "gain"):
            air = air._replace(gain=parameters["gain"])
        case ("regulator_error", "offset"):
            air = air._replace(offset=parameters["offset_bar"] * BAR)
        case ("seal_friction", "coulomb"):
            law = law._replace(seal=parameters["force_n"])
        case ("seal_friction", "stribeck"):
            speed = parameters["stribeck_speed_mm_per_s"] * 1e-3
            law = law._replace(
                stribeck=parameters["force_n"], stribeck_rise=parameters["stick_fraction"], stribeck_speed=speed
            )
        case ("seal_friction", "pressure"):
            law = law._replace(
                pressed_seal=parameters["force_n"],
                seal_growth=parameters["growth_per_bar"] / BAR,
                seal_stiffness=parameters["stiffness_n_per_mm"] * 1e3,
            )
        case ("seal_friction", "lugre"):
            speed, reach = parameters["speed_mm_per_s"] * 1e-3, parameters["reach_mm"] * 1e-3
            law = law._replace(
                lugre=parameters["force_n"], lugre_rise=parameters["rise"], lugre_speed=speed, lugre_reach=reach
            )
        case ("laminar_orifice", "smooth"):
            law = law._replace(transition=parameters["transition_speed_mm_per_s"] * 1e-3)
        case ("discharge_loss", "constant"):
            loss = parameters["discharge_coefficient"] ** 2
            law = law._replace(damping_in=law.damping_in / loss, damping_out=law.damping_out / loss)
        case ("tendon_hysteresis", "slip"):
            law = law._replace(tendon_loss=parameters["loss_fraction"])
        case ("tendon_hysteresis", "maxwell"):
            law = law._replace(
                tendon_stiffness=parameters["stiffness_n_per_mm"] * 1e3, tendon_time=parameters["time_constant_s"]
            )
        case ("tendon_slack", "dead_length"):
            law = law._replace(tendon_slack=parameters["slack_mm"] * 1e-3)
        case ("tendon_slack", "toe"):
            law = law._replace(toe=parameters["toe_mm"] * 1e-3)
        case ("braid_hysteresis", "dahl" | "bouc_wen"):
            law = law._replace(
                hysteretic_slope=parameters["slope_n_per_bar"] / BAR,
                hysteretic_stiffness=parameters["stiffness_n_per_mm"] * 1e3,
                hysteretic_gamma=parameters.get("gamma_over_beta", 0.0),
            )
        case ("braid_hysteresis", "prandtl_ishlinskii"):
            law = law._replace(play_slope=parameters["slope_n_per_bar"] / BAR, play_reach=parameters["reach_mm"] * 1e-3)
        case ("braid_extensibility", "linear"):
            law = law._replace(thread_strain=parameters["strain_per_bar"] / BAR)
        case ("thick_wall_bladder", "mooney_rivlin"):
            law = law._replace(thick=parameters["share"])
        case ("bladder_softening", "ogden_roxburgh"):
            law = law._replace(softening=parameters["share"], softening_energy=parameters["energy_density_kpa"] * 1e3)
        case ("bladder_relaxation", "log_time"):
            law = law._replace(creep=parameters["stiffness_n_per_mm"] * 1e3)
        case ("muscle_damping", "warming"):
            law = law._replace(warm=parameters["coefficient_n_s_per_m"], warm_gain=parameters["loss_per_j"])
        case ("end_taper", "quadratic"):
            law = law._replace(bulge=parameters["factor"])
        case ("trapped_air", "isothermal"):
            law = law._replace(damper_air=parameters["air_volume_cm3"] * 1e-6)
        case ("rod_side_area", "single_rod"):
            law = law._replace(rod_area=math.pi / 4 * (parameters["rod_diameter_mm"] * 1e-3) ** 2)
        case ("cavitation", "charge"):
            inverse = parameters["inverse_charge_per_bar"]
            law = law._replace(charge=BAR / inverse if inverse > 0.0 else 0.0)
        case ("oil_temperature", "walther"):
            thicker, denser = compare_oil(parameters["temperature_c"])
            speed = parameters["transition_speed_mm_per_s"] * 1e-3
            law = law._replace(damping_in=denser * law.damping_in, damping_out=denser * law.damping_out)
            law = law._replace(transition_rise=(thicker**2 - 1.0) * speed**2)
        case ("tendon_stiffening", "quadratic"):
            law = law._replace(stiffening=parameters["stiffening_n_per_mm2"] * 1e6)
        case _:
            air = _apply_supply_effect(air, key, parameters)
    return law, air


def _apply_supply_effect(air: AirSupply, key: tuple[str, str], parameters: Mapping[str, float]) -> AirSupply:
    """Apply an effect that couples the pressure to the motion."""
    match key:
        case ("choked_valve", "symmetric"):
            air = _add_valve(air, parameters["resistance_s_bar_per_dm3"], 1.0, parameters["critical_ratio"])
        case ("choked_valve", "asymmetric"):
            air = _add_valve(
                air,
                parameters["fill_resistance_s_bar_per_dm3"],
                parameters["exhaust_factor"],
                parameters["critical_ratio"],
            )
        case ("hose", "tube"):
            air = _add_hose(air, parameters["length_m"], parameters["inner_diameter_mm"] * 1e-3)
        case ("volume_coupling", "polytropic"):
            if parameters["recovery_s"] > 0.0:
                air = air._replace(recovery_time=parameters["recovery_s"], exponent=parameters["exponent"])
        case ("leak", form):
            air = air._replace(
                leak_conductance=parameters["conductance_dm3_per_s_bar"] * 1e-8, leak_is_crack=float(form == "crack")
            )
        case ("supply_droop", "tank"):
            inverse = parameters["inverse_volume_per_l"] * 1e3
            air = air._replace(tank_volume=1.0 / inverse if inverse > 0.0 else 0.0)
    return air


def _add_hose(air: AirSupply, length: float, diameter: float) -> AirSupply:
    """Return the supply behind a hose in which the pressure gradient balances the friction of the wall.

    Isothermal gas: ``rho dp/dx = -f G^2/(2 d)`` with ``rho = p/(R T)`` and the mass flow per area ``G``, integrated
    over the length: ``G^2 = (p1^2 - p2^2) d/(f L R T)``. Sound travels at ``sqrt(1.4 R T)``.
    """
    if length == 0.0:
        return air
    if air.fill_conductance > 0.0:
        raise ValueError("a hose behind a valve is not covered")
    bore = math.pi / 4 * diameter**2
    flow_per_pressure = bore * math.sqrt(diameter / (HOSE_FRICTION * length * GAS_CONSTANT * air.temperature))
    conductance = flow_per_pressure * math.sqrt(air.temperature) / REFERENCE_DENSITY_FACTOR
    return air._replace(
        fill_conductance=conductance,
        exhaust_conductance=conductance,
        critical_ratio=0.0,
        dead_volume=air.dead_volume + bore * length,
        dead_time=air.dead_time + length / math.sqrt(1.4 * GAS_CONSTANT * air.temperature),
    )


def _add_valve(air: AirSupply, resistance: float, exhaust_factor: float, critical_ratio: float) -> AirSupply:
    """Return the supply with a valve whose exhaust resistance is ``exhaust_factor`` times its fill resistance.

    Conductances are the inverses of the resistances; 1 dm3/(s bar) is 1e-8 m3/(s Pa).
    """
    if resistance == 0.0:
        return air
    return air._replace(
        fill_conductance=1e-8 / resistance,
        exhaust_conductance=1e-8 / (resistance * exhaust_factor),
        critical_ratio=critical_ratio,
    )
