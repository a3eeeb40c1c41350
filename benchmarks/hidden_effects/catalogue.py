"""Effects that can be hidden in a dataset: names, forms and parameters.

Names, units, typical sizes and neutral values of ``EFFECTS`` equal those of the public catalogue, and their ranges lie
within its ranges. ``OTHER_FORMS`` are functional forms that are in no catalogue. ``neutral`` is the value without
effect, or ``None`` for a parameter that only shapes an effect (a time constant, a reach).
"""

import math
from typing import Any, NamedTuple


class HiddenParameter(NamedTuple):
    """One parameter of an effect, in the unit of its name."""

    low: float
    high: float
    typical: float
    neutral: float | None = 0.0
    is_signed: bool = False
    """Whether the parameter may deviate from neutral in both directions."""


Forms = dict[tuple[str, str], dict[str, HiddenParameter]]
MIN_VALVE_RESISTANCE = 0.2
"""Smallest hidden resistance of a valve [s bar/dm3]. Any smaller valve acts alike: it replaces the ideal regulator by a
pilot whose rate is limited, which alone changes the pressure by 80 mbar (rms). So no data contain its resistance."""
MIN_HOSE_LENGTH = 0.5
"""Shortest hidden hose [m]: 25 of the largest inner diameters. A hose, too, replaces the ideal regulator, so a shorter
one hardly acts less, and the search for a small size would end at micrometres."""

MAX_RANGE_FRACTION = 0.9
"""Largest distance of a parameter from neutral, over that of the end of its range; of a shape, the distance of its ends
from 0. A value at the end of the catalogue's range cannot be told from one beyond it, so no diagnosis can name it."""


def limit_to_range(parameter: HiddenParameter, value: float) -> float:
    """Return ``value`` of ``parameter``, rounded, within :data:`MAX_RANGE_FRACTION` of its range."""
    low, high, neutral = parameter.low, parameter.high, parameter.neutral
    if neutral is None or neutral == math.inf:  # a shape, or a frequency: slower is more
        low, high = low / MAX_RANGE_FRACTION, high if neutral else MAX_RANGE_FRACTION * high
    else:
        low = max(low, neutral + MAX_RANGE_FRACTION * (low - neutral))
        high = min(high, neutral + MAX_RANGE_FRACTION * (high - neutral))
    return float(f"{min(max(value, low), high):.6g}")


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
    ("trapped_air", "isothermal"): {"air_volume_cm3": HiddenParameter(0, 10, 1)},
    ("rod_side_area", "single_rod"): {"rod_diameter_mm": HiddenParameter(0, 18, 8)},
    ("cavitation", "charge"): {"inverse_charge_per_bar": HiddenParameter(0, 1, 0.3)},
    ("oil_temperature", "walther"): {
        "temperature_c": HiddenParameter(-10, 80, 5, 20.0),
        "transition_speed_mm_per_s": HiddenParameter(1, 500, 40, None),
    },
    ("tendon_stiffening", "quadratic"): {"stiffening_n_per_mm2": HiddenParameter(0, 100, 2)},
    ("choked_valve", "symmetric"): {
        "resistance_s_bar_per_dm3": HiddenParameter(MIN_VALVE_RESISTANCE, 50, 4),
        "critical_ratio": HiddenParameter(0.1, 0.6, 0.5, None),
    },
    ("choked_valve", "asymmetric"): {
        "fill_resistance_s_bar_per_dm3": HiddenParameter(MIN_VALVE_RESISTANCE, 50, 4),
        "exhaust_factor": HiddenParameter(0.1, 10, 2, None),
        "critical_ratio": HiddenParameter(0.1, 0.6, 0.5, None),
    },
    ("hose", "tube"): {
        "length_m": HiddenParameter(MIN_HOSE_LENGTH, 20, 2),
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
    ("socket_pistoning", "damped"): {
        "compliance_mm_per_kn": HiddenParameter(0, 60, 10),
        "time_constant_s": HiddenParameter(0.003, 0.3, 0.03, None),
    },
    ("socket_tilt", "elastic"): {
        "compliance_deg_per_n_m": HiddenParameter(0, 0.3, 0.03),
        "height_mm": HiddenParameter(100, 600, 330, None),
    },
    ("socket_tilt", "damped"): {
        "compliance_deg_per_n_m": HiddenParameter(0, 0.3, 0.03),
        "height_mm": HiddenParameter(100, 600, 330, None),
        "time_constant_s": HiddenParameter(0.003, 0.3, 0.03, None),
    },
}
"""Effects of foot, ankle and socket, which show in gait."""

JOINT_EFFECTS: Forms = {
    ("joint_friction", "coulomb"): {"moment_n_m": HiddenParameter(0, 20, 0.1)},
    ("joint_friction", "stribeck"): {
        "moment_n_m": HiddenParameter(0, 20, 0.1),
        "static_excess": HiddenParameter(0.05, 3, 0.5, None),
        "stribeck_velocity_deg_per_s": HiddenParameter(0.5, 200, 10, None),
    },
    ("joint_friction", "presliding"): {
        "moment_n_m": HiddenParameter(0, 20, 0.1),
        "presliding_deg": HiddenParameter(0.05, 20, 1, None),
    },
    ("joint_inertia", "armature"): {"inertia_kg_cm2": HiddenParameter(0, 1e5, 50)},
    ("pulley_error", "radius"): {"gain": HiddenParameter(0.7, 1.4, 1.05, 1.0, True)},
    ("gravity_tilt", "about_y"): {"tilt_deg": HiddenParameter(-45, 45, 2, 0.0, True)},
}
"""Effects of a joint, which show in blocks of the joint. Its viscous friction is a number of the model."""
OUT_OF_CATALOGUE_JOINT_FORMS: Forms = {
    ("eccentric_pulley", "sine"): {"eccentricity_mm": HiddenParameter(0, 10, 1)},
    ("cable_bundle", "quadratic"): {"moment_n_m": HiddenParameter(0, 20, 0.5)},
}
"""Effects of a joint that are in no catalogue."""

TENDONS = ("flexor", "extensor")
"""Tendons of the antagonist joint, which each carry a device."""
VALVE_EFFECTS = {"leak"}
"""Effects that a regulator compensates; they are hidden in a device with a known valve."""
EXACT_TWINS = {
    "braid_hysteresis": ("seal_friction",),
    "joint_friction": ("seal_friction",),
    "discharge_loss": ("number_error",),
    "laminar_orifice": ("oil_temperature",),
    "oil_temperature": ("laminar_orifice",),
    "pressure_delay": ("hose",),
    "tendon_slack": ("number_error",),
}
"""Effect -> effects of the public catalogue with a form that contains it or equals it. An effect that is to be in no
catalogue is removed together with them.

A seal that rubs in proportion to pressure is a braid that does. Seals of both muscles rub on a pulley as its bearing
does, but for the stretch of the cables (they take 93 % of the squared error of prediction that the friction of the
joint leaves). Oil a little colder than its transition speed allows for is laminar flow: their sensitivities have a
cosine of 0.98, and no change of the rig splits them. An orifice that loses flow is a wrong bore or oil density, slack
is a wrong length of tendon or muscle, and a wide hose delays the pressure by the time that sound takes."""
TWIN_NUMBERS: dict[str, tuple[str, ...]] = {
    "discharge_loss": ("damper.bore_mm", "damper.oil_density_kg_m3"),
    "tendon_slack": (),
}
"""Effect -> numbers of the device that are its exact twins if they are wrong, without those declared uncertain.

Slack is the length of the tendon, which is uncertain. A longer muscle resembles it (cosine 0.96) only where nothing
measures the length of the muscle."""
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
    # In the catalogue it is a candidate for cylinders only: the seal of a damper beside a muscle meets the oil.
    ("seal_friction", "pressure"): {
        "force_n": HiddenParameter(0, 200, 8),
        "growth_per_bar": HiddenParameter(0.01, 5, 0.3, None),
        "stiffness_n_per_mm": HiddenParameter(1, 1000, 50, None),
    },
}

LATER_FORMS: Forms = {
    ("tendon_hysteresis", "viscous"): {"damping_n_s_per_mm": HiddenParameter(0, 20, 1)},
    ("choked_valve", "downstream"): {
        "resistance_s_bar_per_dm3": HiddenParameter(MIN_VALVE_RESISTANCE, 50, 4),
        "critical_ratio": HiddenParameter(0.1, 0.6, 0.5, None),
    },
    ("tendon_hysteresis", "maxwell_slip"): {
        "friction_n": HiddenParameter(0, 1000, 20),
        "presliding_mm": HiddenParameter(0.02, 50, 1, None),
    },
    ("tendon_stiffening", "gradual_engagement"): {"transition_mm": HiddenParameter(0, 10, 0.5)},
    ("muscle_damping", "power_law"): {
        "coefficient_n_s_per_m": HiddenParameter(0, 3000, 150),
        "exponent": HiddenParameter(0.3, 0.9, 0.5, None),
    },
}
"""Forms that the public catalogue got after the splits were drawn. No block hides them, so no dataset changes."""


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


JOINT_CHANNELS = {
    "angle_joint": Channel("deg", 0.05, 0.96, 1.0, 0.3, 0.3),
    "pressure_flexor": BENCH_CHANNELS["pressure"],
    "pressure_extensor": BENCH_CHANNELS["pressure"],
}
JOINT_LOAD_CELLS = {"force_flexor": BENCH_CHANNELS["force"], "force_extensor": BENCH_CHANNELS["force"]}
"""Channels that only a proposed change of the joint's rig adds."""


def instrument_forms(channel: str) -> Forms:
    """Return the instrument faults of ``channel``; offsets, drifts and steps are in its unit."""
    _, _, gain, offset, drift, step = {**GAIT_CHANNELS, **BENCH_CHANNELS, **JOINT_CHANNELS}[channel]
    backlash: Forms = {("sensor_backlash", "play"): {"play": HiddenParameter(0, 10, 0.3)}}
    return {
        **(backlash if channel == "angle_joint" else {}),
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
