"""What can be hidden in a dataset: names, forms, parameters; and how they enter the law.

The names, units, ranges and typical sizes of the ``EFFECTS`` are those of the program's public catalogue;
``OTHER_FORMS`` are functional forms that are in no catalogue. ``neutral`` is the value at which a parameter does
nothing, or ``None`` for a parameter that only shapes an effect (a time constant, a reach).
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from air import Air, moves
from law import Law

PRESET = Path(__file__).parents[2] / "src" / "klute_sim" / "device" / "presets" / "klute-3-4-pair.toml"
BAR = 1e5


class Parameter(NamedTuple):
    """One parameter of an effect, in the unit of its name."""

    low: float
    high: float
    typical: float
    neutral: float | None = 0.0
    signed: bool = False
    """Whether the effect may go either way from neutral."""


Forms = dict[tuple[str, str], dict[str, Parameter]]

EFFECTS: Forms = {
    ("braid_hysteresis", "coulomb"): {"slope_n_per_bar": Parameter(0, 60, 8)},
    ("braid_hysteresis", "maxwell_slip"): {
        "slope_n_per_bar": Parameter(0, 60, 8),
        "stiffness_n_per_mm": Parameter(1, 500, 40, None),
    },
    ("muscle_damping", "viscous"): {"coefficient_n_s_per_m": Parameter(0, 3000, 150)},
    ("muscle_damping", "pressure"): {"coefficient_n_s_per_m": Parameter(0, 1000, 40)},
    ("threshold_pressure", "constant"): {"pressure_bar": Parameter(0, 3, 0.5)},
    ("threshold_pressure", "rising"): {"pressure_bar": Parameter(0, 3, 0.5), "rise_bar": Parameter(0, 60, 10)},
    ("end_taper", "cone"): {"tip_length_mm": Parameter(0, 40, 8)},
    ("end_taper", "strain"): {"factor": Parameter(0, 5, 1)},
    ("bladder_relaxation", "maxwell"): {
        "stiffness_n_per_mm": Parameter(0, 50, 3),
        "time_constant_s": Parameter(0.02, 100, 1, None),
    },
    ("pressure_lag", "first_order"): {"time_constant_s": Parameter(0, 0.5, 0.05)},
    ("pressure_delay", "dead_time"): {"delay_s": Parameter(0, 0.3, 0.04)},
    ("regulator_error", "gain"): {"gain": Parameter(0.7, 1.3, 0.95, 1.0, True)},
    ("regulator_error", "offset"): {"offset_bar": Parameter(-0.5, 0.5, 0.1, 0.0, True)},
    ("seal_friction", "coulomb"): {"force_n": Parameter(0, 200, 15)},
    ("laminar_orifice", "smooth"): {"transition_speed_mm_per_s": Parameter(0, 500, 40)},
    ("discharge_loss", "constant"): {"discharge_coefficient": Parameter(0.4, 1, 0.7, 1.0)},
    ("tendon_hysteresis", "slip"): {"loss_fraction": Parameter(0, 0.5, 0.06)},
    ("tendon_hysteresis", "maxwell"): {
        "stiffness_n_per_mm": Parameter(0, 200, 10),
        "time_constant_s": Parameter(0.01, 10, 0.3, None),
    },
    ("tendon_slack", "dead_length"): {"slack_mm": Parameter(0, 20, 1.5)},
    ("braid_hysteresis", "bouc_wen"): {
        "slope_n_per_bar": Parameter(0, 60, 8),
        "stiffness_n_per_mm": Parameter(1, 500, 40, None),
    },
    ("braid_extensibility", "linear"): {"strain_per_bar": Parameter(0, 0.03, 0.003)},
    ("thick_wall_bladder", "mooney_rivlin"): {"share": Parameter(0, 3, 1)},
    ("bladder_softening", "ogden_roxburgh"): {
        "share": Parameter(0, 0.9, 0.3),
        "energy_density_kpa": Parameter(0.1, 1000, 10, None),
    },
    ("seal_friction", "stribeck"): {
        "force_n": Parameter(0, 200, 15),
        "stick_fraction": Parameter(0.05, 3, 0.6, None),
        "stribeck_speed_mm_per_s": Parameter(1, 200, 15, None),
    },
    ("trapped_air", "dead_stroke"): {"stroke_mm": Parameter(0, 20, 3)},
    ("tendon_stiffening", "quadratic"): {"stiffening_n_per_mm2": Parameter(0, 100, 2)},
    ("choked_valve", "symmetric"): {
        "resistance_s_bar_per_dm3": Parameter(0, 50, 4),
        "critical_ratio": Parameter(0.1, 0.6, 0.5, None),
    },
    ("choked_valve", "asymmetric"): {
        "fill_resistance_s_bar_per_dm3": Parameter(0, 50, 4),
        "exhaust_factor": Parameter(0.1, 10, 2, None),
        "critical_ratio": Parameter(0.1, 0.6, 0.5, None),
    },
    ("volume_coupling", "polytropic"): {
        "recovery_s": Parameter(0, 5, 0.05),
        "exponent": Parameter(1, 1.4, 1.2, None),
    },
    ("leak", "orifice"): {"conductance_dm3_per_s_bar": Parameter(0, 1, 0.02)},
    ("supply_droop", "tank"): {"inverse_volume_per_l": Parameter(0, 20, 4)},
}

BODY: Forms = {
    ("ankle_friction", "coulomb"): {"moment_n_m": Parameter(0, 15, 2)},
    ("ankle_friction", "viscous"): {"damping_n_m_s": Parameter(0, 10, 1)},
    ("return_spring_error", "stiffness"): {"gain": Parameter(0.3, 3, 1.1, 1.0, True)},
    ("return_spring_error", "rest"): {"shift_deg": Parameter(-15, 15, 1, 0.0, True)},
    ("end_stop", "bumper"): {
        "stiffness_n_m_per_deg": Parameter(0, 100, 4),
        "begin_deg": Parameter(1, 25, 7, None),
    },
    ("moment_arm_error", "insertion"): {"gain": Parameter(0.7, 1.4, 1.05, 1.0, True)},
    ("inertia_error", "mass"): {"gain": Parameter(0.4, 3, 1.4, 1.0, True)},
    ("foot_stiffness", "linear"): {"compliance_deg_per_n_m": Parameter(0, 0.5, 0.05)},
    ("foot_hysteresis", "viscous"): {
        "compliance_deg_per_n_m": Parameter(0, 0.5, 0.05),
        "time_constant_s": Parameter(0.002, 2, 0.03, None),
    },
    ("foot_hysteresis", "coulomb"): {
        "compliance_deg_per_n_m": Parameter(0, 0.5, 0.05),
        "moment_n_m": Parameter(0.1, 30, 3, None),
    },
    ("socket_pistoning", "axial"): {"compliance_mm_per_kn": Parameter(0, 60, 10)},
}
"""Of foot, ankle and socket: they show on walks."""

NEEDS_VALVE = {"leak"}
"""Effects that a regulator makes up for: they are hidden in a device that is known to have a valve."""
KNOWN_VALVE: dict[str, Any] = {
    "name": "choked_valve",
    "form": "symmetric",
    "parameters": {"resistance_s_bar_per_dm3": 4.0, "critical_ratio": 0.5},
}

OTHER_FORMS: Forms = {
    ("braid_hysteresis", "dahl"): {
        "slope_n_per_bar": Parameter(0, 60, 8),
        "reach_mm": Parameter(0.05, 5, 0.5, None),
    },
    ("muscle_damping", "power_1_5"): {"coefficient": Parameter(0, 6000, 400)},
    ("pressure_lag", "second_order"): {
        "natural_rad_per_s": Parameter(15, 120, 40, math.inf),
        "damping_ratio": Parameter(0.4, 1.2, 0.7, None),
    },
    ("seal_friction", "lugre"): {
        "force_n": Parameter(0, 60, 15),
        "rise": Parameter(0, 0.4, 0.3, None),
        "speed_mm_per_s": Parameter(30, 100, 50, None),
        "reach_mm": Parameter(0.05, 2, 0.3, None),
    },
    ("tendon_slack", "toe"): {"toe_mm": Parameter(0, 10, 4)},
    ("braid_hysteresis", "prandtl_ishlinskii"): {
        "slope_n_per_bar": Parameter(0, 60, 8),
        "reach_mm": Parameter(0.2, 20, 3, None),
    },
    ("bladder_relaxation", "log_time"): {"stiffness_n_per_mm": Parameter(0, 20, 1)},
    ("muscle_damping", "warming"): {
        "coefficient_n_s_per_m": Parameter(0, 3000, 300),
        "loss_per_j": Parameter(0.001, 0.1, 0.01, None),
    },
    ("end_taper", "quadratic"): {"factor": Parameter(0, 40, 8)},
    ("leak", "crack"): {"conductance_dm3_per_s_bar": Parameter(0, 1, 0.03)},
}


class Channel(NamedTuple):
    """A measured channel: its unit, and in that unit its noise rms and the typical faults of its instrument."""

    unit: str
    noise: float
    gain: float
    offset: float
    drift: float
    step: float


CHANNELS = {
    "force": Channel("N", 3.0, 0.96, 15.0, 4.0, 12.0),
    "pressure": Channel("bar", 0.01, 0.96, 0.08, 0.02, 0.04),
    "muscle_length": Channel("mm", 0.02, 0.997, 0.3, 0.08, 0.08),
}


ON_WALKS = {
    "ankle_angle": Channel("deg", 0.1, 0.96, 1.0, 0.3, 0.3),
    "force": Channel("N", 5.0, 0.96, 15.0, 4.0, 12.0),
    "pressure": Channel("bar", 0.01, 0.96, 0.08, 0.02, 0.04),
    "muscle_length": Channel("mm", 0.05, 0.997, 0.3, 0.08, 0.08),
}


def instrument_forms(channel: str) -> Forms:
    """Faults of the instrument on ``channel``; offsets, drifts and steps are in the channel's unit."""
    _, _, gain, offset, drift, step = {**ON_WALKS, **CHANNELS}[channel]
    return {
        ("sensor_gain", "gain"): {"gain": Parameter(0.8, 1.2, gain, 1.0, True)},
        ("sensor_offset", "offset"): {"offset": Parameter(-10 * offset, 10 * offset, offset, 0.0, True)},
        ("sensor_drift", "linear"): {"drift_per_s": Parameter(-10 * drift, 10 * drift, drift, 0.0, True)},
        ("sensor_lag", "first_order"): {"time_constant_s": Parameter(0, 0.2, 0.02)},
        ("clock_skew", "shift"): {"shift_s": Parameter(0, 0.1, 0.015)},
        ("quantisation", "linear"): {"step": Parameter(0, 10 * step, step)},
    }


UNCERTAIN: dict[str, float] = {
    "muscle.c10_kpa": 0.10,
    "muscle.friction_slope_n_per_bar": 0.10,
    "tendon.stiffness_1_n_per_mm": 0.10,
    "tendon.stiffness_2_n_per_mm": 0.10,
    "tendon.slack_length_mm": 0.01,
    "damper.orifice_concentric_mm": 0.03,
    "damper.orifice_eccentric_mm": 0.03,
}


def load_device(path: Path = PRESET) -> dict[str, float]:
    """Numbers of a device file as ``table.key``, in the units of the keys."""
    document = tomllib.loads(path.read_text("utf-8"))
    words = {"sources", "effects"}
    tables = {name: table for name, table in document.items() if isinstance(table, dict) and name not in words}
    return {f"{name}.{key}": float(value) for name, table in tables.items() for key, value in table.items()}


def neutral_law(device: Mapping[str, float]) -> tuple[Law, Air]:
    """The device without hidden effects, in SI."""

    def get(key: str, factor: float = 1.0) -> float:
        return device[key] * factor

    rest = get("muscle.resting_length_mm", 1e-3)
    turns = get("muscle.turns_per_m") * rest
    outer = get("muscle.bladder_radius_mm", 1e-3)
    inner = outer - get("muscle.bladder_thickness_mm", 1e-3)
    bore, density = get("damper.bore_mm", 1e-3), get("damper.oil_density_kg_m3")

    def orifice(key: str) -> float:  # inverse of (4.6), with the design's discharge coefficient of 1
        ratio = bore / get(key, 1e-3)
        return math.pi * bore**2 / 4 * density / 2 * (ratio**4 - 1.0)

    law = Law(
        count=get("muscle.count"),
        rest=rest,
        braid=get("muscle.braid_length_ratio") * rest,
        turns=turns,
        bladder_gain=math.pi * (outer**2 - inner**2),
        hoop=(rest / (2 * math.pi * turns * outer)) ** 2,
        outer=outer,
        inner=inner,
        c10=get("muscle.c10_kpa", 1e3),
        c01=get("muscle.c01_kpa", 1e3),
        friction_slope=get("muscle.friction_slope_n_per_bar", 1 / BAR),
        friction_offset=get("muscle.friction_offset_n"),
        damping_in=orifice("damper.orifice_concentric_mm"),
        damping_out=orifice("damper.orifice_eccentric_mm"),
        slack=get("tendon.slack_length_mm", 1e-3),
        stiffness_1=get("tendon.stiffness_1_n_per_mm", 1e3),
        stiffness_2=get("tendon.stiffness_2_n_per_mm", 1e3),
        engagement=get("tendon.engagement_mm", 1e-3),
        **dict.fromkeys(Law._fields[Law._fields.index("coulomb_slope") :], 0.0),
    )
    divisors = ("slip_stiffness", "bouc_stiffness", "softening_energy", "relax_time", "stribeck_speed", "tendon_time")
    divisors += ("dahl_reach", "play_reach", "lugre_speed", "lugre_reach")
    law = law._replace(**dict.fromkeys(divisors, 1.0))
    air = Air(
        supply=get("supply.pressure_bar", BAR),
        rate=get("supply.rate_bar_per_s", BAR),
        **dict.fromkeys(Air._fields[2:], 0.0),
    )
    warm = device["supply.gas_temperature_c"] + 273.15
    air = air._replace(gain=1.0, damping=1.0, temperature=warm, exponent=1.0)
    return law, air


def with_effects(law: Law, air: Air, effects: Sequence[Mapping[str, Any]]) -> tuple[Law, Air]:
    """The same device with ``effects`` in it, each ``{"name", "form", "parameters"}``."""
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
        law, air = _put(law, air, key, p)
    if air.fill > 0.0:  # behind a valve there is no regulator that makes up for what the motion does
        air = air._replace(recovery=0.0, exponent=1.0)
    if moves(air) and air.natural > 0.0:
        raise ValueError("second-order dynamics are for a pressure that does not depend on the motion")
    # Floats only: an integer would be another type to the compiled functions, and compile them again.
    return Law(*map(float, law)), Air(*map(float, air))


def _put(law: Law, air: Air, key: tuple[str, str], p: Mapping[str, float]) -> tuple[Law, Air]:
    match key:
        case ("braid_hysteresis", "coulomb"):
            law = law._replace(coulomb_slope=p["slope_n_per_bar"] / BAR)
        case ("braid_hysteresis", "maxwell_slip"):
            stiffness = p["stiffness_n_per_mm"] * 1e3
            law = law._replace(slip_slope=p["slope_n_per_bar"] / BAR, slip_stiffness=stiffness)
        case ("braid_hysteresis", "dahl"):
            law = law._replace(dahl_slope=p["slope_n_per_bar"] / BAR, dahl_reach=p["reach_mm"] * 1e-3)
        case ("muscle_damping", "viscous"):
            law = law._replace(viscous=p["coefficient_n_s_per_m"])
        case ("muscle_damping", "pressure"):
            law = law._replace(viscous_pressure=p["coefficient_n_s_per_m"] / BAR)
        case ("muscle_damping", "power_1_5"):
            law = law._replace(power=p["coefficient"])
        case ("threshold_pressure", _):
            law = law._replace(threshold=p["pressure_bar"] * BAR, threshold_rise=p.get("rise_bar", 0.0) * BAR)
        case ("end_taper", "cone"):
            law = law._replace(tip=4 / 3 * p["tip_length_mm"] * 1e-3)
        case ("end_taper", "strain"):
            law = law._replace(taper=p["factor"])
        case ("bladder_relaxation", "maxwell"):
            law = law._replace(relax_stiffness=p["stiffness_n_per_mm"] * 1e3, relax_time=p["time_constant_s"])
        case ("pressure_lag", "first_order"):
            air = air._replace(lag=p["time_constant_s"])
        case ("pressure_lag", "second_order"):
            natural = p["natural_rad_per_s"]
            air = air._replace(natural=natural if math.isfinite(natural) else 0.0, damping=p["damping_ratio"])
        case ("pressure_delay", "dead_time"):
            air = air._replace(delay=p["delay_s"])
        case ("regulator_error", "gain"):
            air = air._replace(gain=p["gain"])
        case ("regulator_error", "offset"):
            air = air._replace(offset=p["offset_bar"] * BAR)
        case ("seal_friction", "coulomb"):
            law = law._replace(seal=p["force_n"])
        case ("seal_friction", "stribeck"):
            speed = p["stribeck_speed_mm_per_s"] * 1e-3
            law = law._replace(stribeck=p["force_n"], stribeck_rise=p["stick_fraction"], stribeck_speed=speed)
        case ("seal_friction", "lugre"):
            speed, reach = p["speed_mm_per_s"] * 1e-3, p["reach_mm"] * 1e-3
            law = law._replace(lugre=p["force_n"], lugre_rise=p["rise"], lugre_speed=speed, lugre_reach=reach)
        case ("laminar_orifice", "smooth"):
            law = law._replace(transition=p["transition_speed_mm_per_s"] * 1e-3)
        case ("discharge_loss", "constant"):
            loss = p["discharge_coefficient"] ** 2
            law = law._replace(damping_in=law.damping_in / loss, damping_out=law.damping_out / loss)
        case ("tendon_hysteresis", "slip"):
            law = law._replace(tendon_loss=p["loss_fraction"])
        case ("tendon_hysteresis", "maxwell"):
            law = law._replace(tendon_stiffness=p["stiffness_n_per_mm"] * 1e3, tendon_time=p["time_constant_s"])
        case ("tendon_slack", "dead_length"):
            law = law._replace(tendon_slack=p["slack_mm"] * 1e-3)
        case ("tendon_slack", "toe"):
            law = law._replace(toe=p["toe_mm"] * 1e-3)
        case ("braid_hysteresis", "bouc_wen"):
            stiffness = p["stiffness_n_per_mm"] * 1e3
            law = law._replace(bouc_slope=p["slope_n_per_bar"] / BAR, bouc_stiffness=stiffness)
        case ("braid_hysteresis", "prandtl_ishlinskii"):
            law = law._replace(play_slope=p["slope_n_per_bar"] / BAR, play_reach=p["reach_mm"] * 1e-3)
        case ("braid_extensibility", "linear"):
            law = law._replace(thread_strain=p["strain_per_bar"] / BAR)
        case ("thick_wall_bladder", "mooney_rivlin"):
            law = law._replace(thick=p["share"])
        case ("bladder_softening", "ogden_roxburgh"):
            law = law._replace(softening=p["share"], softening_energy=p["energy_density_kpa"] * 1e3)
        case ("bladder_relaxation", "log_time"):
            law = law._replace(creep=p["stiffness_n_per_mm"] * 1e3)
        case ("muscle_damping", "warming"):
            law = law._replace(warm=p["coefficient_n_s_per_m"], warm_gain=p["loss_per_j"])
        case ("end_taper", "quadratic"):
            law = law._replace(bulge=p["factor"])
        case ("trapped_air", "dead_stroke"):
            law = law._replace(dead_stroke=p["stroke_mm"] * 1e-3)
        case ("tendon_stiffening", "quadratic"):
            law = law._replace(stiffening=p["stiffening_n_per_mm2"] * 1e6)
        case _:
            air = _supplied(air, key, p)
    return law, air


def _supplied(air: Air, key: tuple[str, str], p: Mapping[str, float]) -> Air:
    """The same for what couples the pressure to the motion."""
    match key:
        case ("choked_valve", "symmetric"):
            air = _behind(air, p["resistance_s_bar_per_dm3"], 1.0, p["critical_ratio"])
        case ("choked_valve", "asymmetric"):
            air = _behind(air, p["fill_resistance_s_bar_per_dm3"], p["exhaust_factor"], p["critical_ratio"])
        case ("volume_coupling", "polytropic"):
            if p["recovery_s"] > 0.0:
                air = air._replace(recovery=p["recovery_s"], exponent=p["exponent"])
        case ("leak", form):
            air = air._replace(leak=p["conductance_dm3_per_s_bar"] * 1e-8, leak_opens=float(form == "crack"))
        case ("supply_droop", "tank"):
            inverse = p["inverse_volume_per_l"] * 1e3
            air = air._replace(tank=1.0 / inverse if inverse > 0.0 else 0.0)
    return air


def _behind(air: Air, resistance: float, factor: float, ratio: float) -> Air:
    """A valve whose resistance to exhaust is ``factor`` times that to fill.

    Conductances are the resistances' inverses; 1 dm3/(s bar) is 1e-8 m3/(s Pa).
    """
    if resistance == 0.0:
        return air
    return air._replace(fill=1e-8 / resistance, exhaust=1e-8 / (resistance * factor), ratio=ratio)
