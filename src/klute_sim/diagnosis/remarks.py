"""Remarks about fitted numbers, tolerances and displays, which are among the reasons of a verdict."""

from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.noise.quantization import Quantizer
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection

MIN_REPORTED_SIGMAS = 2.0
"""Change of an uncertain number in a fit that the reasons state, in its standard deviations (assumed)."""


def describe_contradicted_numbers(fit: Fit) -> list[str]:
    """Return a sentence for each wrong number that was declared uncertain, by less than it is wrong."""
    deviations = dict(fit.hypothesis.uncertainties)
    rows = zip(fit.hypothesis.parameters, fit.values, strict=True)
    wrong = [(p, value, deviations[p.name]) for p, value in rows if p.term_index is not None and p.name in deviations]
    return [
        f"{p.name} is declared as {p.initial:.4g} with a standard deviation of {deviation:.3g}; the fitted value "
        f"is {abs(value - p.initial) / deviation:.1f} standard deviations away."
        for p, value, deviation in wrong
    ]


def describe_refitted_numbers(fit: Fit) -> list[str]:
    """Return a sentence about the uncertain numbers that the fit changed by more than usual; none without any."""
    changes = [
        f"{p.name} from {p.initial:.4g} to {value:.4g} ({abs(x):.1f})"
        for p, value, x in zip(fit.hypothesis.parameters, fit.values, fit.x, strict=True)
        if p.name in dict(fit.hypothesis.uncertainties) and p.term_index is None and abs(x) > MIN_REPORTED_SIGMAS
    ]
    if not changes:
        return []
    return [f"The fit changes declared numbers, in brackets by how many standard deviations: {', '.join(changes)}."]


def describe_exceeded_tolerance(search: ForwardSelection, base_fit: Fit) -> list[str]:
    """Return a sentence about the misfits that exceed the stated tolerance; none without any."""
    parts = []
    for channel, misfit in search.find_relevant_misfits(base_fit).items():
        unit, si = CHANNEL_UNITS[channel]
        tolerance = search.tolerance.get(channel, 0.0)
        if tolerance:
            parts.append(f"{channel} by {misfit.rms / si:.3g} {unit} (tolerance {tolerance / si:.3g} {unit})")
    if not parts:
        return []
    return [f"Without effects the simulation misses {', '.join(parts)}: more than the stated tolerance."]


def describe_quantization(channel: str, quantizer: Quantizer) -> str:
    """Return a sentence about the resolution of a ``channel``."""
    unit, si = CHANNEL_UNITS[channel]
    return (
        f"'{channel}' is quantised in steps of {quantizer.resolution / si:.4g} {unit}, "
        f"{1.0 / quantizer.dither:.1f} times the noise before quantisation; the step is that of the measured values."
    )
