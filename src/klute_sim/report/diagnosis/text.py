"""Words and numbers of a diagnosis as a person says them."""

import math
import re
from collections.abc import Sequence

import numpy as np

from klute_sim import units
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, FitParameter
from klute_sim.diagnosis.selection.equation_residuals import EQUATION_UNITS as UNITS_OF_EQUATIONS
from klute_sim.diagnosis.selection.equation_residuals import select_significant_equations as lacking_of
from klute_sim.diagnosis.workflow import Diagnosis
from klute_sim.effects import catalogue

SIGNIFICANT_DIGITS = 4
"""Significant ones."""
MAX_DECIMALS = 9
"""Where numbers have to be told apart."""
QUANTITY_BY_UNIT = {"N": "force", "bar": "pressure"}
"""Unit that an equation's lack is shown in -> what it is of."""
PROPER_NAMES = {name.lower(): name for name in ("Bouc", "Coulomb", "Maxwell", "Stribeck", "Wen")}
"""Parts of identifiers that are people's names."""


def format_number(value: float, digits: int = SIGNIFICANT_DIGITS) -> str:
    """``value`` with so many significant digits and no needless zeros."""
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else ("∞" if value > 0.0 else "-∞")
    if value != 0.0 and not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits - 1}e}"
    return np.format_float_positional(value, precision=digits, unique=False, fractional=False, trim="-")


def format_interval(value: float, lower: float, upper: float) -> tuple[str, str, str]:
    """``value`` and both ends of its interval, all with the decimals that tell the nearest two of them apart.

    The largest has :data:`DIGITS` digits or more; there are no more than :data:`MOST_DECIMALS` decimals.
    """
    every = (value, lower, upper)
    most = max(map(abs, every))
    between = [distance for distance in (abs(value - lower), abs(upper - value)) if distance > 0.0]
    if not math.isfinite(sum(every)) or not between or not 1e-4 <= most < 1e7:
        return format_number(value), format_number(lower), format_number(upper)
    decimals = max(SIGNIFICANT_DIGITS - 1 - math.floor(math.log10(most)), -math.floor(math.log10(min(between))), 0)
    decimals = min(decimals, MAX_DECIMALS)
    shown, bottom, top = (f"{round(one, decimals) + 0.0:.{decimals}f}" for one in every)
    return shown, bottom, top


def humanize_identifier(identifier: str) -> str:
    """``muscle_length`` -> ``muscle length``."""
    return " ".join(PROPER_NAMES.get(part, part) for part in identifier.split("_"))


def format_term(term: EffectTerm) -> str:
    """An effect, its form if there is a choice, and its channel."""
    form = f" ({humanize_identifier(term.form)})" if len(term.effect_definition.forms) > 1 else ""
    of = f" of {humanize_identifier(term.channel)}" if term.channel else ""
    return f"{humanize_identifier(term.effect)}{form}{of}"


def humanize_text(text: str) -> str:
    """``text`` with the identifiers of effects, forms and channels in it spoken."""
    effects = catalogue.get_effects().values()
    known = {*catalogue.get_effects(), *CHANNEL_UNITS, *(form.name for effect in effects for form in effect.forms)}
    names = "|".join(re.escape(name) for name in known if "_" in name or name in PROPER_NAMES)
    return re.sub(
        rf"(?<!\w)(?:{names})(?!\w)", lambda match: humanize_identifier(match[0].lower()), text, flags=re.IGNORECASE
    )


def format_sentence(text: str) -> str:
    """:func:`spoken_in`, with a capital at the start."""
    found = humanize_text(text)
    return found[:1].upper() + found[1:]


def split_key(key: str) -> tuple[str, str]:
    """A key's name without its unit, spoken, and the unit."""
    name, unit = units.split_unit(key)
    return humanize_identifier(name), unit


def format_parameter_name(parameter: FitParameter, channel: str | None) -> tuple[str, str]:
    """Name and unit of a fitted number; one that an instrument counts in its channel's own unit is in that."""
    if channel is None or math.isfinite(parameter.upper):
        return split_key(parameter.key)
    name, unit = split_key(parameter.key)
    own = CHANNEL_UNITS[channel][0]
    return name.removesuffix(" per"), f"{own}/s" if unit == "s" and parameter.key.endswith("_per_s") else own


def join_words(words: Sequence[str], conjunction: str = "and") -> str:
    """``a, b and c``."""
    return f" {conjunction} ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def describe_verdict(diagnosis: Diagnosis) -> str:
    """The answer in one sentence."""
    if diagnosis.verdict == "insufficient-data":
        if not diagnosis.added_terms:
            return "These data cannot tell whether the simulation lacks anything."
        names = join_words([format_term(t) for t in diagnosis.added_terms])
        return f"These data cannot tell for sure, because nothing was repeated; {names} would explain what stands out."
    if diagnosis.verdict == "nothing-missing":
        return "Nothing is missing: the simulation agrees with the data as well as repeats agree with each other."
    if diagnosis.verdict == "unexplained":
        if not diagnosis.added_terms:
            return "The simulation lacks something, and no effect that was looked for explains it."
        proxies = [format_term(t) for t in diagnosis.added_terms if not t.effect_definition.data_driven]
        extra = "a data-driven term, which names nothing, stands in for it"
        if not proxies:
            return f"The simulation lacks something that no effect that was looked for explains; {extra}."
        comes = "come" if len(proxies) > 1 else "comes"
        beside = f"; for the rest {extra}" if len(proxies) < len(diagnosis.added_terms) else ""
        closest = f"{join_words(proxies)} {comes} closest, as a proxy"
        return f"The simulation lacks something that is not fully explained; {closest}{beside}."
    parts = []
    kinds = (("device", "the simulated device lacks"), ("body", "the simulated foot and ankle lack"))
    for kind, words in (*kinds, ("instrument", "an instrument is at fault:")):
        own = [format_term(t) for t in diagnosis.added_terms if t.effect_definition.kind == kind]
        if kind == "instrument":
            own += [f"quantisation of {humanize_identifier(channel)}" for channel in diagnosis.quantizers]
        if own:
            parts.append(f"{words} {join_words(own)}")
    found = "; ".join(parts)
    if diagnosis.verdict == "ambiguous":
        others = list(
            dict.fromkeys(format_term(rival.fit.hypothesis.terms[-1]) for rival in diagnosis.equivalent_models)
        )
        found += f"; {join_words(others, 'or')} would explain the data as well, and they cannot tell which it is"
    return f"{found[0].upper()}{found[1:]}."


def describe_equation_residuals(diagnosis: Diagnosis) -> str:
    """In which of the device's equations something is missing, in one sentence.

    '' if none does, if none could be checked, or if an instrument is at fault: they are believed here.
    """
    lacking = lacking_of(diagnosis.equation_residuals)
    if not lacking or any(term.channel for term in diagnosis.added_terms):
        return ""
    parts = []
    for each in lacking:
        unit, si = UNITS_OF_EQUATIONS[each.name]
        parts.append(
            f"{format_number(each.rms / si, 3)} {unit} rms of {QUANTITY_BY_UNIT[unit]} are missing in {_format_equation(each.name)}"
        )
    parts += [
        f"nothing is missing in {_format_equation(each.name)}"
        for each in diagnosis.equation_residuals
        if each not in lacking
    ]
    return f"If the instruments are right, {'; '.join(parts)}."


def _format_equation(equation: str) -> str:
    return equation if equation.startswith("muscle") else f"the {equation}"


def describe_improvement(diagnosis: Diagnosis) -> str:
    """What became of the gap of the channel that was worst, in one sentence; '' if nothing was fitted."""
    ratios = {
        channel: gap.refitted / gap.noise_floor for channel, gap in diagnosis.channel_rms.items() if gap.noise_floor
    }
    if not ratios:
        return ""
    worst = max(ratios, key=lambda channel: ratios[channel])
    unit, si = CHANNEL_UNITS[worst]
    own = diagnosis.channel_rms[worst]
    shown = (own.refitted, own.with_effects, own.noise_floor or 0.0)
    before, after, floor = (f"{format_number(value / si, 3)} {unit}" for value in shown)
    where = "trials that no fit saw" if diagnosis.evaluated_on == "show" else "the fitted trials (none was kept back)"
    if not diagnosis.added_terms:
        return f"On {where}, simulated and measured {humanize_identifier(worst)} differ by {before} rms; noise alone is {floor}."
    return (
        f"On {where}, the {humanize_identifier(worst)} gap goes from {before} to {after} rms; noise alone is {floor}."
    )
