"""Summary of a design as one JSON object with units in the keys."""

import math
from typing import Any

import numpy as np

from klute_sim.sizing.choices import ACTUATOR_LABELS, PA_PER_MPA
from klute_sim.sizing.evaluation.demand import StrideDemand
from klute_sim.sizing.parts.actuator import compute_required_pressure
from klute_sim.sizing.parts.damper import DamperDesignPoint
from klute_sim.sizing.sensitivity import (
    DesignMetrics,
    SensitivityResult,
    compute_design_metrics,
    list_excluded_assumptions,
)
from klute_sim.sizing.sizing import Design
from klute_sim.sizing.target import WalkerTarget
from klute_sim.units import BAR

CAVITATION_NOTE = (
    "assumed: the oil leaves into a reservoir at atmosphere, its vapour pressure is negligible, and (4.6) puts the "
    "narrowest section of the jet at the pressure behind the orifice; no back pressure is designed in"
)
"""Assumptions of the cavitation number."""


def build_summary(design: Design, sensitivities: list[SensitivityResult]) -> dict[str, Any]:
    """Return target, dimensions, performance, demand and sensitivity of ``design``."""
    muscle, choices = design.muscle, design.choices
    walker = design.target if isinstance(design.target, WalkerTarget) else None
    return {
        "device": design.device.name,
        "target": {
            "muscle": muscle.name,
            "f0_n": muscle.isometric_force,
            "l0_mm": None if muscle.resting_length is None else 1e3 * muscle.resting_length,
            "mass_kg": walker.mass if walker else None,
            "reference": walker.reference.name if walker else None,
            "peak_moment_nm": walker.compute_peak_moment()[0] if walker else None,
            "a_over_f0": muscle.hill.a,
            "b_over_vmax": muscle.hill.b,
            "saturation": muscle.hill.saturation,
            "vmax_mm_per_s": 1e3 * muscle.design_peak_velocity,
            "vmax_assumed": muscle.peak_velocity is None,
        },
        "required_force_n": design.required_force,
        "isometric_force_n": design.isometric_force,
        "required_length_ratio": design.selected.length_ratio if design.required_force else None,
        "force_ratio": design.selected.count * design.selected.available_force / design.required_force
        if design.required_force
        else None,
        "pressure_for_required_force_bar": _pressure_for_required_force(design),
        "supply_pressure_bar": choices.supply_pressure / BAR,
        "design_ratio": choices.assumptions.design_ratio,
        "actuator": design.selected.actuator,
        "count": design.selected.count,
        "resting_length_mm": 1e3 * design.selected.resting_length,
        "slenderness": design.selected.slenderness,
        "rows": [
            {
                "actuator": o.actuator,
                "label": ACTUATOR_LABELS[o.actuator],
                "isometric_force_n": o.isometric_force,
                "available_force_n": o.available_force,
                "length_ratio": o.length_ratio,
                "count": o.count,
                "total_isometric_force_n": o.total_force,
                "total_available_force_n": o.count * o.available_force,
                "resting_length_mm": 1e3 * o.resting_length,
                "gas_ml": 1e6 * o.gas_volume,
                "is_sufficient": o.is_sufficient,
            }
            for o in design.candidates
        ],
        "damper": {
            "bore_mm": round(1e3 * design.damper.bore, 6),
            "bore_is_fixed": choices.bore is not None,
            "required_bore_mm": 1e3 * design.damper.required_bore,
            "pressure_mpa": design.damper.max_pressure / PA_PER_MPA,
            "allowed_pressure_mpa": choices.assumptions.cylinder_pressure / PA_PER_MPA,
            "concentric": _encode_point(design.damper.concentric),
            "eccentric": _encode_point(design.damper.eccentric),
            "cavitation_note": CAVITATION_NOTE,
        },
        "tendon": design.device.spec.tendon.model_dump() if design.device.spec.tendon else None,
        "envelope": [
            {"name": b.name, "low": b.low, "high": b.high, "value": b.value, "is_met": b.is_met}
            for b in design.envelope
        ],
        "rms_error_f0": {
            name: {"concentric": m.concentric, "eccentric": m.eccentric}
            for name, m in design.compute_force_velocity_errors().items()
        },
        "demand": _encode_demand(design.demand) if design.demand else None,
        "profile": design.profile.describe() if design.profile else None,
        "fixed_fields": sorted(choices.fixed_fields),
        "assumptions": design.device.spec.collect_assumptions(),
        "sensitivity": {
            "nominal": _encode_metrics(compute_design_metrics(design)),
            "rows": [_encode_sensitivity(e) for e in sensitivities],
            "excluded_assumptions": list_excluded_assumptions(design),
        },
    }


def _pressure_for_required_force(design: Design) -> float | None:
    """Return the gauge pressure [bar] that just gives the required force; None without a requirement or above 20
    bar.
    """
    if design.required_force is None:
        return None
    muscle = design.device.parameters.muscle
    pressure = compute_required_pressure(
        muscle, design.required_force, design.selected.length_ratio * muscle.resting_length
    )
    return None if math.isnan(pressure) else pressure / BAR


def _encode_point(point: DamperDesignPoint) -> dict[str, float]:
    return {
        "speed_mm_per_s": 1e3 * point.speed,
        "design_force_n": point.design_force,
        "as_built_force_n": point.as_built_force,
        "orifice_mm": round(1e3 * point.orifice_diameter, 6),
        "pressure_mpa": point.pressure / PA_PER_MPA,
        "jet_speed_m_per_s": point.jet_speed,
        "cavitation_number": point.cavitation_number,
        "refill_passage_mm": 1e3 * point.min_refill_diameter,
    }


def _encode_demand(demand: StrideDemand) -> dict[str, Any]:
    peak, weakest = int(demand.tendon_force.argmax()), int(np.nanargmin(demand.force_margin))
    required_pressure = demand.required_pressure
    max_required_pressure = None if np.isnan(required_pressure).any() else float(required_pressure.max()) / BAR
    return {
        "tendon_peak_n": float(demand.tendon_force[peak]),
        "tendon_peak_phase_pct": 100.0 * float(demand.phase[peak]),
        "max_isometric_force_at_peak_n": float(demand.max_isometric_force[peak]),
        "commanded_isometric_force_at_peak_n": float(demand.commanded_isometric_force[peak]),
        "peak_moment_fraction": demand.peak_moment_fraction,
        "min_force_margin": float(demand.force_margin[weakest]),
        "min_force_margin_phase_pct": 100.0 * float(demand.phase[weakest]),
        "max_required_pressure_bar": max_required_pressure,
        "length_ratio_min": float(demand.length_ratio.min()),
        "length_ratio_max": float(demand.length_ratio.max()),
        "at_stop_pct": 100.0 * float(demand.at_stop.mean()),
        "max_shortening_velocity_mm_per_s": -1e3 * float(demand.muscle_velocity.min()),
        "max_lengthening_velocity_mm_per_s": 1e3 * float(demand.muscle_velocity.max()),
        "air_g": 1e3 * demand.air_mass,
    }


def _encode_metrics(metrics: DesignMetrics) -> dict[str, Any]:
    return {
        "orifice_concentric_mm": round(1e3 * metrics.orifice_concentric, 6),
        "orifice_eccentric_mm": round(1e3 * metrics.orifice_eccentric, 6),
        "cylinder_pressure_mpa": metrics.cylinder_pressure / PA_PER_MPA,
        "peak_moment_fraction": metrics.peak_moment_fraction,
        "rms_error_concentric_f0": metrics.rms_error_concentric,
        "rms_error_eccentric_f0": metrics.rms_error_eccentric,
        "air_g": None if metrics.air_mass is None else 1e3 * metrics.air_mass,
        "recommended_actuators": metrics.recommended_actuators,
    }


def _encode_sensitivity(sensitivity: SensitivityResult) -> dict[str, Any]:
    variation = sensitivity.variation
    digits = 6 - math.ceil(math.log10(abs(sensitivity.value / variation.si_factor))) if sensitivity.value else 6
    return {
        "assumption": variation.name,
        "unit": variation.unit,
        "nominal": round(variation.nominal / variation.si_factor, digits),
        "value": round(sensitivity.value / variation.si_factor, digits),
        "reason": variation.reason,
        "metrics": None if sensitivity.metrics is None else _encode_metrics(sensitivity.metrics),
    }
