"""A design as one JSON object, units in the keys."""

import math
from typing import Any

import numpy as np

from klute_sim.design.actuator import pressure_for
from klute_sim.design.choices import MPA, ROWS
from klute_sim.design.damper import DesignPoint
from klute_sim.design.demand import Demand
from klute_sim.design.sensitivity import Effect, Outcome, left_out, outcome
from klute_sim.design.sizing import Design
from klute_sim.design.target import Walker
from klute_sim.units import BAR

CAVITATION = (
    "assumed: the oil leaves into a reservoir at atmosphere, its vapour pressure is negligible, and (4.6) puts the "
    "narrowest place of the jet at the pressure behind the orifice; no back pressure is designed in"
)


def summary(found: Design, effects: list[Effect]) -> dict[str, Any]:
    """Everything the command reports."""
    muscle, choices = found.muscle, found.choices
    walker = found.target if isinstance(found.target, Walker) else None
    return {
        "device": found.device.name,
        "target": {
            "muscle": muscle.name,
            "f0_n": muscle.isometric_force,
            "l0_mm": None if muscle.resting_length is None else 1e3 * muscle.resting_length,
            "mass_kg": walker.mass if walker else None,
            "reference": walker.reference.name if walker else None,
            "peak_moment_nm": walker.peak()[0] if walker else None,
            "a_over_f0": muscle.hill.a,
            "b_over_vmax": muscle.hill.b,
            "saturation": muscle.hill.saturation,
            "vmax_mm_per_s": 1e3 * muscle.velocity,
            "vmax_assumed": muscle.peak_velocity is None,
        },
        "needed_force_n": found.needed_force,
        "force_n": found.force,
        "needed_ratio": found.option.ratio if found.needed_force else None,
        "strength": found.option.count * found.option.strength / found.needed_force if found.needed_force else None,
        "pressure_for_needed_force_bar": _pressure_for_needed(found),
        "supply_pressure_bar": choices.supply_pressure / BAR,
        "design_ratio": choices.assumptions.design_ratio,
        "actuator": found.option.actuator,
        "count": found.option.count,
        "resting_length_mm": 1e3 * found.option.resting_length,
        "slenderness": found.option.slenderness,
        "rows": [
            {
                "actuator": o.actuator,
                "row": ROWS[o.actuator],
                "force_of_one_n": o.force,
                "strength_of_one_n": o.strength,
                "ratio": o.ratio,
                "count": o.count,
                "force_n": o.total,
                "strength_n": o.count * o.strength,
                "resting_length_mm": 1e3 * o.resting_length,
                "gas_ml": 1e6 * o.volume,
                "sufficient": o.sufficient,
            }
            for o in found.options
        ],
        "damper": {
            "bore_mm": round(1e3 * found.damper.bore, 6),
            "bore_given": choices.bore is not None,
            "needed_bore_mm": 1e3 * found.damper.needed_bore,
            "pressure_mpa": found.damper.pressure / MPA,
            "allowed_pressure_mpa": choices.assumptions.cylinder_pressure / MPA,
            "concentric": _point(found.damper.concentric),
            "eccentric": _point(found.damper.eccentric),
            "cavitation_note": CAVITATION,
        },
        "tendon": found.device.spec.tendon.model_dump() if found.device.spec.tendon else None,
        "envelope": [
            {"name": b.name, "low": b.low, "high": b.high, "found": b.found, "met": b.met} for b in found.envelope
        ],
        "misfit_f0": {
            name: {"concentric": m.concentric, "eccentric": m.eccentric} for name, m in found.misfit().items()
        },
        "demand": _demand(found.demand) if found.demand else None,
        "profile": found.profile.describe() if found.profile else None,
        "given": sorted(choices.given),
        "assumptions": found.device.spec.assumed(),
        "sensitivity": {
            "base": _outcome(outcome(found)),
            "rows": [_effect(e) for e in effects],
            "left_out": left_out(found),
        },
    }


def _pressure_for_needed(found: Design) -> float | None:
    """Gauge pressure [bar] that would just give the force asked for; None: there is none, or it is beyond 20 bar."""
    if found.needed_force is None:
        return None
    muscle = found.device.parameters.muscle
    pressure = pressure_for(muscle, found.needed_force, found.option.ratio * muscle.resting_length)
    return None if math.isnan(pressure) else pressure / BAR


def _point(point: DesignPoint) -> dict[str, float]:
    return {
        "speed_mm_per_s": 1e3 * point.speed,
        "damping_n": point.damping,
        "damping_as_made_n": point.braking,
        "orifice_mm": round(1e3 * point.orifice, 6),
        "pressure_mpa": point.pressure / MPA,
        "oil_speed_m_per_s": point.oil_speed,
        "cavitation_number": point.cavitation_number,
        "refill_passage_mm": 1e3 * point.refill_passage,
    }


def _demand(demand: Demand) -> dict[str, Any]:
    peak, weakest = int(demand.tendon.argmax()), int(np.nanargmin(demand.margin))
    needed = demand.needed_pressure
    return {
        "tendon_peak_n": float(demand.tendon[peak]),
        "tendon_peak_pct": 100.0 * float(demand.phase[peak]),
        "strongest_at_peak_n": float(demand.strongest[peak]),
        "commanded_at_peak_n": float(demand.commanded[peak]),
        "peak_share": demand.peak_share,
        "least_margin": float(demand.margin[weakest]),
        "least_margin_pct": 100.0 * float(demand.phase[weakest]),
        "needed_pressure_bar": None if np.isnan(needed).any() else float(needed.max()) / BAR,
        "ratio_min": float(demand.ratio.min()),
        "ratio_max": float(demand.ratio.max()),
        "at_stop_pct": 100.0 * float(demand.at_stop.mean()),
        "fastest_shortening_mm_per_s": -1e3 * float(demand.rate.min()),
        "fastest_lengthening_mm_per_s": 1e3 * float(demand.rate.max()),
        "air_g": 1e3 * demand.air,
    }


def _outcome(found: Outcome) -> dict[str, Any]:
    return {
        "orifice_concentric_mm": round(1e3 * found.orifice_concentric, 6),
        "orifice_eccentric_mm": round(1e3 * found.orifice_eccentric, 6),
        "cylinder_pressure_mpa": found.cylinder_pressure / MPA,
        "peak_share": found.peak_share,
        "misfit_concentric_f0": found.misfit_concentric,
        "misfit_eccentric_f0": found.misfit_eccentric,
        "air_g": None if found.air is None else 1e3 * found.air,
        "would_take": found.would_take,
    }


def _effect(effect: Effect) -> dict[str, Any]:
    varied = effect.variation
    digits = 6 - math.ceil(math.log10(abs(effect.value / varied.factor))) if effect.value else 6
    return {
        "assumption": varied.name,
        "unit": varied.unit,
        "base": round(varied.base / varied.factor, digits),
        "value": round(effect.value / varied.factor, digits),
        "why": varied.why,
        "outcome": None if effect.outcome is None else _outcome(effect.outcome),
    }
