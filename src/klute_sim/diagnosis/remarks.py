"""Remarks about commands, fitted numbers, tolerances and displays, which are among the reasons of a verdict."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from klute_sim.datasets.mechanism_channels import normalize_name
from klute_sim.datasets.trial import COMMAND_CHANNEL, Trial
from klute_sim.device.device import Device
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.dependent_numbers import RADIUS, THICKNESS, compute_mounting_error
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.noise.misfit import is_significant
from klute_sim.diagnosis.noise.quantization import MAX_DITHER, MIN_DITHER, Quantizer
from klute_sim.diagnosis.selection.forward_selection import ForwardSelection
from klute_sim.effects.families.muscle.threshold_pressure import REFERENCE_DIAMETER
from klute_sim.types import Array
from klute_sim.units import BAR

MIN_REPORTED_SIGMAS = 2.0
"""Change of an uncertain number in a fit that the reasons state, in its standard deviations (assumed)."""

MIN_MOUNTING_ERROR_MM = 0.05
"""Smallest error of a mounting [mm] that the reasons state (assumed: a tenth of what a ruler shows)."""
MAX_INTERVAL_FRACTION = 0.5
"""Largest part of the allowed range, logarithmic for a shape, that an interval may cover before the reasons say that
the value is not determined (assumed)."""
HIGH_COMMAND_PERCENTILE = 99.0
"""Percentile of the commands of a trial that is compared with the supply; a spike in a log is higher (assumed)."""
CONFOUNDED_WITH_LENGTH_ZERO = frozenset({"tendon_slack", "tendon.slack_length_mm"})
"""Effect and number that a wrong zero of the length imitates exactly."""
EFFECTS_OF_REFERENCE_DIAMETER = frozenset({"threshold_pressure", "passive_tension"})
"""Effects whose parameters are stated for a bladder of :data:`REFERENCE_DIAMETER`."""
MIN_DIAMETER_DIFFERENCE = 0.02
"""Relative difference of a diameter from :data:`REFERENCE_DIAMETER` from which on the reasons state it (assumed)."""
MAX_COMMAND_RATIO = 1.02
"""Largest ratio of a command to the pressure of the supply that is no reason for a remark (assumed: a calibration)."""


def describe_tested_candidates(only: Sequence[str], exclude: Sequence[str]) -> list[str]:
    """Return a sentence about the candidates that the user selected or excluded by name; none without such names."""
    clauses = [f"only {', '.join(only)} may be named"] if only else []
    clauses += [f"{', '.join(exclude)} may not be named"] if exclude else []
    if not clauses:
        return []
    sentence = f"By choice of the user {', and '.join(clauses)}: whether other causes explain the data was not examined"
    return [f"{sentence}, and the probabilities do not count them." if only else f"{sentence}."]


def describe_excessive_commands(trials: Sequence[Trial]) -> list[str]:
    """Return a sentence about the commands that exceed the supply of their device; none without any.

    The simulated pressure stays at that of the supply, so names and numbers that raise the force may imitate a supply
    that is stated too low.
    """
    excesses: dict[str, tuple[float, float]] = {}
    for trial in trials:
        for device, command in _pair_commands(trial):
            highest, supply = float(np.percentile(command, HIGH_COMMAND_PERCENTILE)), device.parameters.supply
            if supply.command_is_opening == 0.0 and highest > MAX_COMMAND_RATIO * supply.max_pressure:
                excesses[trial.name] = max(
                    excesses.get(trial.name, (0.0, 0.0)), (highest - supply.max_pressure, supply.max_pressure)
                )
    if not excesses:
        return []
    name = max(excesses, key=lambda each: excesses[each][0])
    excess, pressure = excesses[name]
    return [
        f"The commands of {len(excesses)} of {len(trials)} trials exceed supply.pressure_bar = {pressure / BAR:.3g} of "
        f"the device, by up to {excess / BAR:.3g} bar in '{name}'; the simulated pressure stays below it. Correct the "
        "number if the real supply is higher."
    ]


def _pair_commands(trial: Trial) -> Iterator[tuple[Device, Array]]:
    """Yield each device of ``trial`` that has a supply, with its commands [Pa]."""
    devices = {f"{COMMAND_CHANNEL}_{normalize_name(tendon)}": device for tendon, device in trial.devices.items()}
    for channel, device in (devices or {COMMAND_CHANNEL: trial.device}).items():
        if channel in trial.prescribed and device.spec.supply is not None:
            yield device, trial.prescribed[channel].value


def describe_length_zero(trials: Sequence[Trial], fits: Iterable[Fit]) -> list[str]:
    """Return a sentence if some of the ``fits`` name what a wrong zero of the prescribed length looks like.

    A longer tendon at rest and a length that reads too much are the same in every reading.
    """
    names = {term.number or term.effect for fit in fits for term in fit.hypothesis.terms} & CONFOUNDED_WITH_LENGTH_ZERO
    if not names or not any("length" in trial.prescribed for trial in trials):
        return []
    return [
        f"A wrong zero of the prescribed 'length' looks like {' and '.join(sorted(names))} in every reading: check the "
        "zero of the machine before you correct the device."
    ]


def describe_rubber(fits: Iterable[Fit]) -> list[str]:
    """Return a sentence if one of the ``fits`` corrects the wall of the bladder: other rubber looks alike.

    The tension of the bladder is in proportion to its volume of rubber (3.3), and so to both of its moduli together.
    """
    for fit in fits:
        if THICKNESS in (term.number for term in fit.hypothesis.terms):
            device = fit.hypothesis.device
            numbers = device.spec.collect_values()
            corrected = {**numbers, **fit.hypothesis.correct_numbers(device, None, fit.values)}
            after, before = (row[THICKNESS] * (2.0 * row[RADIUS] - row[THICKNESS]) for row in (corrected, numbers))
            return [
                f"A wall of {corrected[THICKNESS]:.3g} instead of {numbers[THICKNESS]:.3g} mm pulls like rubber "
                f"that is {after / before:.3g} times as stiff, in c10 and c01 alike. Measure the wall before you "
                "correct the device."
            ]
    return []


def describe_reference_diameter(fit: Fit) -> list[str]:
    """Return a sentence where fitted effects are stated for a bladder of another diameter than that of the device."""
    names = sorted({term.effect for term in fit.hypothesis.terms} & EFFECTS_OF_REFERENCE_DIAMETER)
    diameter = 2.0 * fit.hypothesis.device.parameters.muscle.bladder_radius
    if not names or abs(diameter / REFERENCE_DIAMETER - 1.0) < MIN_DIAMETER_DIFFERENCE:
        return []
    return [
        f"The parameters of {' and '.join(names)} are those of a bladder of {1e3 * REFERENCE_DIAMETER:g} mm. In this "
        f"muscle of {1e3 * diameter:.3g} mm a threshold pressure is {REFERENCE_DIAMETER / diameter:.3g} times as high, "
        f"and a passive tension {diameter / REFERENCE_DIAMETER:.3g} times."
    ]


def describe_contradicted_numbers(fit: Fit) -> list[str]:
    """Return a sentence for each wrong number that was declared uncertain, by less than it is wrong."""
    deviations = dict(fit.hypothesis.uncertainties)
    rows = zip(fit.hypothesis.parameters, fit.values, strict=True)
    terms = fit.hypothesis.terms
    wrong = [
        (p, value, deviations[p.name])
        for p, value in rows
        if p.term_index is not None and p.name in deviations and terms[p.term_index].specimen is None
    ]
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


def describe_mounting_error(fit: Fit) -> list[str]:
    """Return a sentence where the device file of ``fit`` cannot be mounted as in the fit; none if it can."""
    hypothesis = fit.hypothesis
    declared = hypothesis.device.spec.collect_values()
    error = compute_mounting_error(declared, hypothesis.correct_numbers(hypothesis.device, None, fit.values))
    if abs(error) < MIN_MOUNTING_ERROR_MM:
        return []
    return [
        "The device file cannot state how the fitted device is mounted: mounting.neutral_muscle_ratio is at its limit, "
        f"so the muscle is {abs(error):.2g} mm {'longer' if error > 0.0 else 'shorter'} at a neutral ankle than in the "
        "fit. Measure the lengths of muscle and tendon, and how the device is mounted."
    ]


def describe_undetermined_parameters(fit: Fit, intervals: Sequence[tuple[float, float]]) -> list[str]:
    """Return a sentence about the parameters of added effects that the data hardly determine; none without any.

    ``intervals`` are the confidence intervals of all parameters of ``fit``, each in its own unit.
    """
    undetermined = []
    for parameter, (low, high) in zip(fit.hypothesis.parameters, intervals, strict=True):
        term = None if parameter.term_index is None else fit.hypothesis.terms[parameter.term_index]
        if term is None or term.number or term.effect_definition.data_driven:
            continue
        covered = abs(parameter.normalize(high) - parameter.normalize(low))
        if covered > MAX_INTERVAL_FRACTION * float(np.ptp(parameter.bounds)):
            undetermined.append(f"'{parameter.name}' of {term} ({low:.3g} to {high:.3g})")
    if not undetermined:
        return []
    return [f"The data hardly determine {', '.join(undetermined)}: they show the effect, not this value."]


def describe_tolerance(search: ForwardSelection, base_fit: Fit) -> list[str]:
    """Return a sentence about the misfits that exceed the stated tolerance, or about those that it hides.

    Where it hides none, the sentence states the tolerance if that ended the search, and there is none otherwise.
    """
    relevant = search.find_relevant_misfits(base_fit)
    misfits = search.compute_misfits(base_fit) if search.has_repeats else {}
    hidden = {channel: misfit for channel, misfit in misfits.items() if is_significant(misfit)}
    parts = []
    for channel, misfit in (relevant or hidden).items():
        unit, si = CHANNEL_UNITS[channel]
        tolerance = search.tolerance.get(channel, 0.0)
        if tolerance:
            parts.append(f"{channel} by {misfit.rms / si:.3g} {unit} (tolerance {tolerance / si:.3g} {unit})")
    if not parts:
        limits = [
            f"{channel} {tolerance / CHANNEL_UNITS[channel][1]:.3g} {CHANNEL_UNITS[channel][0]}"
            for channel, tolerance in search.tolerance.items()
        ]
        return [] if search.history else [f"The misfit is within the stated tolerance ({', '.join(limits)})."]
    relation = "more than the stated tolerance" if relevant else "more than the noise, and within the stated tolerance"
    return [f"Without effects the simulation misses {', '.join(parts)}: {relation}."]


def describe_quantization(channel: str, quantizer: Quantizer) -> str:
    """Return a sentence about the resolution of a ``channel``."""
    unit, si = CHANNEL_UNITS[channel]
    ratio = f"{1.0 / quantizer.dither:.1f} times the noise"
    if quantizer.dither <= MIN_DITHER:
        ratio = f"at least {1.0 / MIN_DITHER:.0f} times the noise"
    elif quantizer.dither >= MAX_DITHER:
        ratio = "no more than the noise"
    return (
        f"'{channel}' is quantized in steps of {quantizer.resolution / si:.4g} {unit}, {ratio} before quantization; "
        "the step is that of the measured values."
    )
