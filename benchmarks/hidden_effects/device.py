"""The device of the benchmark in SI units, and the entry of hidden effects into its law."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmarks.hidden_effects.air import GAS_CONSTANT, REFERENCE_DENSITY_FACTOR, AirSupply, is_coupled_to_motion
from benchmarks.hidden_effects.catalogue import EFFECTS, LATER_FORMS, OTHER_FORMS
from benchmarks.hidden_effects.damper import compare_oil
from benchmarks.hidden_effects.law import Law

PRESET_FILE = Path(__file__).parents[2] / "src" / "klute_sim" / "device" / "presets" / "klute-3-4-pair.toml"
BAR = 1e5
HOSE_FRICTION = 0.02
"""Friction factor of a hose after Darcy, as long smooth tubes have in turbulent flow."""


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
    divisors += ("tendon_time", "tendon_presliding", "contact_reach", "play_reach", "lugre_speed", "lugre_reach")
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
        expected = {**EFFECTS, **OTHER_FORMS, **LATER_FORMS}.get(key)
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
    if is_coupled_to_motion(air) and air.regulator_is_upstream == 0.0 and air.natural_frequency > 0.0:
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
        case ("muscle_damping", "power_law"):
            law = law._replace(sublinear=parameters["coefficient_n_s_per_m"], sublinear_exponent=parameters["exponent"])
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
        case ("tendon_hysteresis", "viscous"):
            law = law._replace(tendon_damping=parameters["damping_n_s_per_mm"] * 1e3)
        case ("tendon_hysteresis", "maxwell_slip"):
            law = law._replace(
                tendon_friction=parameters["friction_n"], tendon_presliding=parameters["presliding_mm"] * 1e-3
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
        case ("tendon_stiffening", "gradual_engagement"):
            law = law._replace(engagement_width=parameters["transition_mm"] * 1e-3)
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
        case ("choked_valve", "downstream"):
            air = _add_valve(air, parameters["resistance_s_bar_per_dm3"], 1.0, parameters["critical_ratio"])
            air = air._replace(regulator_is_upstream=float(air.fill_conductance > 0.0))
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
