"""Numbers, phrases and sentences of a diagnosis, shared by its page, figures and recording."""

import math
import re
from collections.abc import Sequence

import numpy as np

from klute_sim import units
from klute_sim.datasets.mechanism import DEVICE_SEPARATOR, is_model_number
from klute_sim.datasets.mechanism_channels import normalize_name
from klute_sim.diagnosis.data_quality import find_moving_trials
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, FitParameter
from klute_sim.diagnosis.fitting.number_error import EFFECTS, FORM_WORDS, LENGTH_ZERO
from klute_sim.diagnosis.localization.equation_residuals import (
    EQUATION_UNITS,
    EquationResidual,
    select_significant_equations,
)
from klute_sim.diagnosis.planning.measurement_plan import select_protocols
from klute_sim.diagnosis.probability import estimate_probabilities
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.effects import catalogue
from klute_sim.plant.mjcf.model_numbers import PREFIX, get_number_unit

SIGNIFICANT_DIGITS = 4
"""Number of significant digits of a formatted number."""
MAX_DECIMALS = 9
"""Maximum number of decimals of values that differ little from each other."""
MIN_DISTANCE_FRACTION = 1e-3
"""Smallest distance of a value from an end of its interval that is shown, as a fraction of the interval."""
EFFECTS_TITLE = "Added effects"
"""Title of the table of effects."""
MAX_HIDDEN_RATIO = 1.5
"""Largest ratio of a gap in which all samples count alike to the printed one that is not stated (assumed)."""
NUMBERS_TITLE = "Corrected numbers"
"""Title of the table of wrong numbers."""
MAX_NOISE_RATIO = 1.1
"""Largest ratio of a gap to the noise between repeats that is agreement."""
DEVICE_PARTS = {
    "muscle and damper": ("muscle", "cylinder", "damper"),
    "muscle, damper or tendon": ("muscle", "cylinder", "damper", "tendon"),
}
"""Kind of an equation residual -> parts that a device may have."""
QUANTITY_BY_UNIT = {"N": "force", "bar": "pressure", "N·m": "moment"}
"""Unit of an equation residual -> its quantity."""
PROPER_NAMES = {name.lower(): name for name in ("Bouc", "Coulomb", "Dahl", "Maxwell", "Stribeck", "Wen")}
"""Parts of identifiers that are names of people."""


def format_number(value: float, digits: int = SIGNIFICANT_DIGITS) -> str:
    """Return ``value`` with ``digits`` significant digits and without trailing zeros."""
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else ("∞" if value > 0.0 else "-∞")
    if value != 0.0 and not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits - 1}e}"
    return np.format_float_positional(value, precision=digits, unique=False, fractional=False, trim="-")


def format_interval(value: float, lower: float, upper: float) -> tuple[str, str, str]:
    """Return ``value`` and the ends of its interval with enough decimals to distinguish all three.

    The largest has at least :data:`SIGNIFICANT_DIGITS` digits; all have at most :data:`MAX_DECIMALS` decimals.
    """
    numbers = (value, lower, upper)
    largest = max(map(abs, numbers))
    min_distance = MIN_DISTANCE_FRACTION * (upper - lower)  # a value at a bound may miss it by rounding
    distances = [distance for distance in (abs(value - lower), abs(upper - value)) if distance > min_distance]
    if not math.isfinite(sum(numbers)) or not distances or not 1e-4 <= largest < 1e7:
        return format_number(value), format_number(lower), format_number(upper)
    decimals = max(SIGNIFICANT_DIGITS - 1 - math.floor(math.log10(largest)), -math.floor(math.log10(min(distances))), 0)
    decimals = min(decimals, MAX_DECIMALS)
    value_text, lower_text, upper_text = (f"{round(number, decimals) + 0.0:.{decimals}f}" for number in numbers)
    return value_text, lower_text, upper_text


def humanize_identifier(identifier: str) -> str:
    """Return ``identifier`` in words: ``muscle_length`` -> ``muscle length``."""
    return " ".join(PROPER_NAMES.get(part, part) for part in identifier.split("_"))


def format_term(term: EffectTerm) -> str:
    """Return the effect of ``term`` in words, with form and owner, or the number that may be wrong."""
    if term.number and is_model_number(term.number):
        element, _, rest = term.number.removeprefix(PREFIX).partition(".")
        name, _, number = rest.rpartition(".")
        return f"{number} of the {element} '{name}'"
    if term.number == LENGTH_ZERO:
        return "zero of the prescribed length"
    if term.number:
        tendon, _, device_key = term.number.rpartition(DEVICE_SEPARATOR)
        section, _, key = device_key.rpartition(".")
        section = humanize_identifier(section.removeprefix(EFFECTS))
        owner = f" on '{tendon}'" if tendon else f" of specimen '{term.specimen}'" if term.specimen else ""
        return f"{split_key(key)[0]} of the {section}{owner}{FORM_WORDS.get(term.form, '')}"
    form = f" ({humanize_identifier(term.form)})" if len(term.effect_definition.forms) > 1 else ""
    owner = f" of {humanize_identifier(term.owner)}" if term.owner else ""
    return f"{humanize_identifier(term.effect)}{form}{owner}"


def humanize_text(text: str) -> str:
    """Return ``text`` with identifiers of effects, forms and channels in words."""
    effects = catalogue.get_effects().values()
    known = {*catalogue.get_effects(), *CHANNEL_UNITS, *(form.name for effect in effects for form in effect.forms)}
    names = "|".join(re.escape(name) for name in known if "_" in name or name in PROPER_NAMES)
    return re.sub(
        rf"(?<!\w)(?:{names})(?!\w)", lambda match: humanize_identifier(match[0].lower()), text, flags=re.IGNORECASE
    )


def format_sentence(text: str) -> str:
    """Return ``text`` with identifiers in words and an initial capital."""
    humanized = humanize_text(text)
    return humanized[:1].upper() + humanized[1:]


def split_key(key: str) -> tuple[str, str]:
    """Return the name of ``key`` in words, and its unit."""
    name, unit = units.split_unit(key)
    return humanize_identifier(name), unit


def format_parameter_name(parameter: FitParameter, channel: str | None) -> tuple[str, str]:
    """Return name and unit of a fitted parameter.

    Parameters of instruments that are in the unit of their channel have the unit of ``channel``.
    """
    if is_model_number(parameter.name):
        return split_key(parameter.name)[0], get_number_unit(parameter.name)
    if channel is None or math.isfinite(parameter.upper):
        return split_key(parameter.name)
    name, unit = split_key(parameter.name)
    channel_unit = CHANNEL_UNITS[channel][0]
    is_rate = unit == "s" and parameter.name.endswith("_per_s")
    return name.removesuffix(" per"), f"{channel_unit}/s" if is_rate else channel_unit


def join_words(words: Sequence[str], conjunction: str = "and") -> str:
    """Return ``words`` as an enumeration: ``a, b and c``."""
    return f" {conjunction} ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def describe_verdict(diagnosis: Diagnosis) -> str:
    """Return the verdict in one sentence."""
    if diagnosis.verdict == "insufficient-data":
        return _describe_insufficient_data(diagnosis)
    if diagnosis.verdict == "nothing-missing" and not diagnosis.selection_history:
        return "Nothing relevant is missing: the misfit is within the stated tolerance."
    if diagnosis.verdict == "nothing-missing":
        condition = " once the registration is corrected" if diagnosis.registration_corrections else ""
        return (
            f"Nothing is missing{condition}: the simulation agrees with the data as well as repeats agree with each "
            "other."
        )
    if diagnosis.verdict == "unexplained":
        return _describe_unexplained(diagnosis)
    clauses = []
    subjects = (
        ("device", "the simulated device lacks"),
        ("body", "the simulated foot and ankle lack"),
        ("mechanism", "the simulated mechanism lacks"),
        ("instrument", "an instrument has a fault:"),
        ("number", "a number of the device file is wrong:"),
        ("model number", "a number of the model is wrong:"),
    )
    for kind, subject in subjects:
        effects = [format_term(t) for t in diagnosis.added_terms if t.effect_definition.kind == kind]
        if kind == "instrument":
            effects += [f"quantisation of {humanize_identifier(channel)}" for channel in diagnosis.quantizers]
        if effects:
            clauses.append(f"{subject} {join_words(effects)}")
    sentence = "; ".join(clauses)
    if diagnosis.verdict in ("identified-in-part", "indistinguishable") and diagnosis.prediction is not None:
        percents = round(100.0 * diagnosis.prediction.share)
        amount = f"{percents} %" if percents < 100 else "practically all"
        rest = "; the rest is unexplained" if percents < 100 else ""
        sentence += f"; this explains {amount} of the squared error of prediction above the noise{rest}"
    if diagnosis.verdict == "indistinguishable":
        sentence += _describe_alternatives(diagnosis)
    return f"{sentence[0].upper()}{sentence[1:]}."


def _describe_alternatives(diagnosis: Diagnosis) -> str:
    """Return the clauses about other names and about a data-driven term in place of the names."""
    sets = [diagnosis.list_added_terms(model.fit) for model in diagnosis.equivalent_models]
    is_free = [any(term.effect_definition.data_driven for term in terms) for terms in sets]
    names: dict[bool, dict[str, None]] = {True: {}, False: {}}
    added = {term.identity for term in diagnosis.added_terms}
    for model, terms, free in zip(diagnosis.equivalent_models, sets, is_free, strict=True):
        if not free:
            is_part = {term.identity for term in terms} < added
            listed = join_words([format_term(t) for t in terms])
            names[model.reaches_noise][f"{listed} alone" if is_part else listed] = None
    by_prediction = any(model.criterion == "prediction error" for model in diagnosis.equivalent_models)
    claim = "predict as well" if by_prediction else "explain the data equally well"
    clauses = f"; {join_words(list(names[True]), 'or')} would {claim}" if names[True] else ""
    if names[False]:
        clauses += f"; {join_words(list(names[False]), 'or')} would explain nearly as much"
    if any(is_free):
        clauses += f"; or an effect is missing that {diagnosis.options.absence}, and a data-driven term represents it"
    return clauses


def _describe_insufficient_data(diagnosis: Diagnosis) -> str:
    if not diagnosis.added_terms:
        return "The data are insufficient to decide whether the simulation lacks an effect."
    names = join_words([format_term(t) for t in diagnosis.added_terms])
    return f"The data are insufficient, because no trial is repeated; {names} would explain the deviation."


def _describe_unexplained(diagnosis: Diagnosis) -> str:
    if not diagnosis.added_terms:
        fitted = diagnosis.fitted_experiments
        if fitted and not find_moving_trials(fitted) and find_moving_trials(diagnosis.experiments):
            return (
                "The simulation deviates from the data, but no fitted trial moves, so effects of motion cannot be "
                "found: set use = 'fit' for a trial that moves."
            )
        return "The simulation deviates from the data, and no candidate effect explains the deviation."
    proxies = [format_term(t) for t in diagnosis.added_terms if not t.effect_definition.data_driven]
    substitute = "a data-driven term, which identifies no effect, represents it"
    if not proxies:
        return f"The simulation deviates from the data, and no candidate effect explains the deviation; {substitute}."
    verb = "come" if len(proxies) > 1 else "comes"
    remainder = f"; for the remainder, {substitute}" if len(proxies) < len(diagnosis.added_terms) else ""
    return (
        "The simulation deviates from the data, and the deviation is not fully explained; "
        f"{join_words(proxies)} {verb} closest, as a proxy{remainder}."
    )


def describe_equation_residuals(diagnosis: Diagnosis) -> str:
    """Return in one sentence which of the device's equations have significant residuals.

    The sentence is empty if none has, if none could be evaluated, or if an instrument has a fault: the residuals assume
    correct instruments.
    """
    significant = [
        residual
        for residual in select_significant_equations(diagnosis.equation_residuals)
        if not (residual.kind == "supply" and _reaches_noise(diagnosis, _name_pressure(residual.part)))
    ]
    if not significant or any(term.channel for term in diagnosis.added_terms):
        return ""
    clauses = []
    for residual in significant:
        unit, si = EQUATION_UNITS[residual.kind]
        clauses.append(
            f"the equation of {_format_equation(residual, diagnosis)} leaves a {QUANTITY_BY_UNIT[unit]} of "
            f"{format_number(residual.rms / si, 3)} {unit} rms"
        )
    clauses += [
        f"that of {_format_equation(residual, diagnosis)} holds within the noise"
        for residual in diagnosis.equation_residuals
        if residual not in significant
    ]
    return f"If the instruments are correct, {'; '.join(clauses)}."


def describe_numbers_at_bounds(diagnosis: Diagnosis) -> str:
    """Return in one sentence which numbers of the device are at a limit of the fit; '' without any."""
    fit = diagnosis.base_fit if diagnosis.is_worse_on_test else diagnosis.final_fit
    if fit is None:
        return ""
    rows = list(zip(fit.hypothesis.parameters, fit.values, strict=True))
    keys = [
        f"{parameter.name} ({format_number(value)} instead of {format_number(parameter.initial)})"
        for parameter, value in (rows[index] for index in fit.find_bounds_reached())
        if parameter.term_index is None
    ]
    if not keys:
        return ""
    verb = "are" if len(keys) > 1 else "is"
    return (
        f"{join_words(keys)} {verb} at a limit of the fit: the data contradict the declared value, its uncertainty, or "
        "the law that contains it."
    )


def describe_probabilities(diagnosis: Diagnosis) -> str:
    """Return the calibrated probabilities in one sentence; '' without a verdict that has any."""
    probabilities = estimate_probabilities(diagnosis)
    if probabilities is None:
        return ""
    clauses = [f"{100.0 * p:.0f} % for {format_term(term)}" for term, p in probabilities.names.items()]
    # An effect that is found may be smaller than the noise, so that both probabilities are large.
    clauses.append(f"{100.0 * probabilities.nothing_missing:.0f} % that nothing as large as the noise is missing")
    source = f"calibrated on {probabilities.n_datasets} simulated datasets of the benchmark"
    sentence = f"Probabilities, {source}: {join_words(clauses)}."
    if diagnosis.verdict == "indistinguishable" and probabilities.names:
        sentence += " The first of equivalent sets was true so often there; these data do not prefer it to the others."
    return sentence


def _name_pressure(device: str | None) -> str:
    """Return the channel of the measured pressure, in a mechanism that of ``device``."""
    return f"pressure_{normalize_name(device)}" if device else "pressure"


def _reaches_noise(diagnosis: Diagnosis, channel: str) -> bool:
    """Return whether the refitted device agrees in ``channel`` as well as repeats agree with each other."""
    gap = diagnosis.channel_rms.get(channel)
    return gap is not None and gap.noise_floor is not None and gap.refitted <= MAX_NOISE_RATIO * gap.noise_floor


def format_effects_title(diagnosis: Diagnosis) -> str:
    """Return the title of the table of effects and wrong numbers."""
    is_number = {term.number is not None for term in diagnosis.added_terms}
    titles = {False: EFFECTS_TITLE, True: NUMBERS_TITLE.lower() if len(is_number) > 1 else NUMBERS_TITLE}
    return " and ".join(title for kind, title in titles.items() if kind in is_number)


def describe_weights(diagnosis: Diagnosis) -> str:
    """Return in one sentence why the gap is smaller than that of a figure; '' where all samples count equally."""
    if not diagnosis.has_input_weights:
        return ""
    clauses = []
    for channel, rms in diagnosis.channel_rms.items():
        unit, si = CHANNEL_UNITS[channel]
        if rms.nominal_unweighted is not None and rms.nominal_unweighted > MAX_HIDDEN_RATIO * rms.nominal:
            clauses.append(f"'{channel}' by {format_number(rms.nominal_unweighted / si, 3)} {unit}")
    counted_alike = f" If all counted alike, the nominal device would miss {', '.join(clauses)} rms." if clauses else ""
    return f"Samples that depend on errors of the inputs count less; figures show all.{counted_alike}"


def describe_next_step(diagnosis: Diagnosis) -> str:
    """Return in one sentence what the files of the diagnosis are for; '' if nothing was fitted."""
    device = diagnosis.fitted_device
    if device is None:
        return ""
    content = _describe_content_of_files(diagnosis)
    if diagnosis.dataset.rig == "mjcf":
        return f"Use: the files of the devices and of the model in this folder hold {content}."
    protocol = select_protocols((), device)[0].name
    return f"Use: device.toml in this folder holds {content}; 'klute-sim bench {protocol} device.toml' simulates it."


def _describe_content_of_files(diagnosis: Diagnosis) -> str:
    """Return what the recommended device holds; faults of instruments and numbers of one specimen are not in it."""
    declared = "what was declared" if diagnosis.dataset.rig == "mjcf" else "the device as declared"
    if diagnosis.recommended_device == "as-declared":
        return declared
    fit = diagnosis.recommended_fit
    parts = []
    if fit.hypothesis.collect_numbers(fit.values) or fit.hypothesis.collect_rig_numbers(fit.values):
        parts.append("the refitted numbers")
    terms = diagnosis.list_added_terms(fit)
    if any(t.effect_definition.kind in ("device", "body", "mechanism") and not t.channel for t in terms):
        parts.append("the effects")
    return join_words(parts) or declared


def _format_equation(residual: EquationResidual, diagnosis: Diagnosis) -> str:
    """Return the name of the equation of ``residual``, without the parts that the device lacks."""
    if residual.kind not in DEVICE_PARTS or residual.part:
        return residual.name if residual.name.startswith("muscle") else f"the {residual.name}"
    spec = diagnosis.dataset.device.spec
    known = {"muscle": spec.muscle, "cylinder": spec.cylinder, "damper": spec.damper, "tendon": spec.tendon}
    parts = [part for part in DEVICE_PARTS[residual.kind] if known[part]]
    return f"the {parts[0]}" if len(parts) == 1 else join_words(parts, "and" if " and " in residual.kind else "or")


def describe_improvement(diagnosis: Diagnosis) -> str:
    """Return in one sentence how the gap of the worst channel changed; '' if nothing was fitted."""
    ratios = {
        channel: gap.refitted / gap.noise_floor for channel, gap in diagnosis.channel_rms.items() if gap.noise_floor
    }
    if not ratios:
        return ""
    worst = max(ratios, key=lambda channel: ratios[channel])
    unit, si = CHANNEL_UNITS[worst]
    gap = diagnosis.channel_rms[worst]
    values = (gap.refitted, gap.with_effects, gap.noise_floor or 0.0)
    before, after, floor = (f"{format_number(value / si, 3)} {unit}" for value in values)
    trials = (
        "test trials" if diagnosis.evaluated_on == "test" else "the fitted trials (there are no usable test trials)"
    )
    channel = humanize_identifier(worst)
    if not diagnosis.added_terms:
        return f"On {trials}, simulated and measured {channel} differ by {before} rms; the noise alone is {floor}."
    change = "rises" if gap.with_effects > gap.refitted else "falls"
    return f"On {trials}, the {channel} gap {change} from {before} to {after} rms; the noise alone is {floor}."
