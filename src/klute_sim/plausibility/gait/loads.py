"""Units of ground reactions and moments, guessed from their size."""

import numpy as np

from klute_sim.types import Array

MAX_SPIKE_PERCENT = 1.0
"""Percentage of samples that may exceed what counts as the peak, such as an impact (assumed)."""
RATIO_RANGE = (0.028, 0.62)
"""Plausible ratio of the largest fore-aft to the largest vertical force; slow walking has 0.05, steep slopes 0.35."""


def measure_peak(values: Array) -> float:
    """Return the largest magnitude of the finite ``values`` without spikes; 0 without values."""
    known = np.abs(values[np.isfinite(values)])
    if known.size == 0:
        return 0.0
    return float(np.percentile(known, 100.0 - MAX_SPIKE_PERCENT)) if known.size > 200 else float(known.max())


def guess_force_unit_per_mass(peak: float) -> str:
    """Return what a vertical force with ``peak``, which should be in N/kg, is in; '' where N/kg is plausible."""
    if 2.95 <= peak <= 49.0:
        return ""
    bounds = (
        (0.2, "kN/kg"),
        (2.95, "body weights (BW) or kN"),
        (135.0, "per cent of body weight (%BW), or kgf"),
        (280.0, "lbf, or per cent of body weight (%BW)"),
        (7e3, "newtons (N), not divided by the body mass"),
    )
    return next((unit for limit, unit in bounds if peak < limit), "a wrong unit")


def guess_moment_unit_per_mass(peak: float) -> str:
    """Return what an ankle moment with ``peak``, which should be in N·m/kg, is in; '' where that is plausible."""
    if 0.12 <= peak <= 4.8:
        return ""
    if peak < 0.12:
        return "kN·m, kN·m/kg or a fraction of body weight times height"
    bounds = (
        (12.5, "per cent of body weight times height"),
        (450.0, "N·m, not divided by the body mass"),
        (7e3, "N·mm/kg"),
        (5e5, "N·mm, not divided by the body mass"),
    )
    return next((unit for limit, unit in bounds if peak < limit), "a wrong unit")


def guess_power_unit_per_mass(peak: float) -> str:
    """Return what an ankle power with ``peak``, which should be in W/kg, is in; '' where that is plausible."""
    if peak <= 35.0:
        return ""
    return "W, not divided by the body mass" if peak < 1500.0 else "mW/kg"


def guess_force_unit(peak: float) -> str:
    """Return what a vertical force with ``peak``, which should be in N, is in; '' where N is plausible."""
    if 135.0 <= peak <= 7e3:
        return ""
    bounds = (
        (0.15, "a wrong unit"),
        (4.0, "kN, or body weights (BW)"),
        (45.0, "N/kg, not multiplied by the body mass"),
        (135.0, "per cent of body weight (%BW), kgf or lbf"),
        (4e4, "lbf that were converted twice, or gf"),
        (7e6, "mN"),
    )
    return next((unit for limit, unit in bounds if peak < limit), "a wrong unit")


def guess_moment_unit(peak: float) -> str:
    """Return what an ankle moment with ``peak``, which should be in N·m, is in; '' where N·m is plausible."""
    if 6.0 <= peak <= 700.0:
        return ""
    if peak < 6.0:
        return "kN·m" if peak < 0.3 else "N·m/kg, not multiplied by the body mass"
    return "N·mm"
