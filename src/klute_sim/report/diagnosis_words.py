"""Words and numbers of a diagnosis as a person says them."""

import math
import re
from collections.abc import Sequence

import numpy as np

from klute_sim import units
from klute_sim.diagnose.diagnosis import Diagnosis
from klute_sim.diagnose.equations import UNITS as UNITS_OF_EQUATIONS
from klute_sim.diagnose.equations import lacking as lacking_of
from klute_sim.diagnose.experiment import UNITS
from klute_sim.diagnose.hypothesis import Term, Unknown
from klute_sim.effects import catalogue

DIGITS = 4
"""Significant ones."""
MOST_DECIMALS = 9
"""Where numbers have to be told apart."""
QUANTITIES = {"N": "force", "bar": "pressure"}
"""Unit that an equation's lack is shown in -> what it is of."""
PROPER = {name.lower(): name for name in ("Bouc", "Coulomb", "Maxwell", "Stribeck", "Wen")}
"""Parts of identifiers that are people's names."""


def number(value: float, digits: int = DIGITS) -> str:
    """``value`` with so many significant digits and no needless zeros."""
    if not math.isfinite(value):
        return "unknown" if math.isnan(value) else ("∞" if value > 0.0 else "-∞")
    if value != 0.0 and not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits - 1}e}"
    return np.format_float_positional(value, precision=digits, unique=False, fractional=False, trim="-")


def told_apart(value: float, low: float, high: float) -> tuple[str, str, str]:
    """``value`` and both ends of its interval, all with the decimals that tell the nearest two of them apart.

    The largest has :data:`DIGITS` digits or more; there are no more than :data:`MOST_DECIMALS` decimals.
    """
    every = (value, low, high)
    most = max(map(abs, every))
    between = [distance for distance in (abs(value - low), abs(high - value)) if distance > 0.0]
    if not math.isfinite(sum(every)) or not between or not 1e-4 <= most < 1e7:
        return number(value), number(low), number(high)
    decimals = max(DIGITS - 1 - math.floor(math.log10(most)), -math.floor(math.log10(min(between))), 0)
    decimals = min(decimals, MOST_DECIMALS)
    shown, bottom, top = (f"{round(one, decimals) + 0.0:.{decimals}f}" for one in every)
    return shown, bottom, top


def spoken(identifier: str) -> str:
    """``muscle_length`` -> ``muscle length``."""
    return " ".join(PROPER.get(part, part) for part in identifier.split("_"))


def term(one: Term) -> str:
    """An effect, its form if there is a choice, and its channel."""
    form = f" ({spoken(one.form)})" if len(one.entry.forms) > 1 else ""
    of = f" of {spoken(one.channel)}" if one.channel else ""
    return f"{spoken(one.effect)}{form}{of}"


def spoken_in(text: str) -> str:
    """``text`` with the identifiers of effects, forms and channels in it spoken."""
    effects = catalogue.effects().values()
    known = {*catalogue.effects(), *UNITS, *(form.name for effect in effects for form in effect.forms)}
    names = "|".join(re.escape(name) for name in known if "_" in name or name in PROPER)
    return re.sub(rf"(?<!\w)(?:{names})(?!\w)", lambda match: spoken(match[0].lower()), text, flags=re.IGNORECASE)


def sentence(text: str) -> str:
    """:func:`spoken_in`, with a capital at the start."""
    found = spoken_in(text)
    return found[:1].upper() + found[1:]


def split_key(key: str) -> tuple[str, str]:
    """A key's name without its unit, spoken, and the unit."""
    name, unit = units.split(key)
    return spoken(name), unit


def unknown(one: Unknown, channel: str | None) -> tuple[str, str]:
    """Name and unit of a fitted number; one that an instrument counts in its channel's own unit is in that."""
    if channel is None or math.isfinite(one.high):
        return split_key(one.key)
    name, unit = split_key(one.key)
    own = UNITS[channel][0]
    return name.removesuffix(" per"), f"{own}/s" if unit == "s" and one.key.endswith("_per_s") else own


def joined(words: Sequence[str], last: str = "and") -> str:
    """``a, b and c``."""
    return f" {last} ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def verdict(diagnosis: Diagnosis) -> str:
    """The answer in one sentence."""
    if diagnosis.verdict == "insufficient-data":
        if not diagnosis.found:
            return "These data cannot tell whether the simulation lacks anything."
        names = joined([term(t) for t in diagnosis.found])
        return f"These data cannot tell for sure, because nothing was repeated; {names} would explain what stands out."
    if diagnosis.verdict == "nothing-missing":
        return "Nothing is missing: the simulation agrees with the data as well as repeats agree with each other."
    if diagnosis.verdict == "unexplained":
        if not diagnosis.found:
            return "The simulation lacks something, and no effect that was looked for explains it."
        proxies = [term(t) for t in diagnosis.found if not t.entry.data_driven]
        extra = "a data-driven term, which names nothing, stands in for it"
        if not proxies:
            return f"The simulation lacks something that no effect that was looked for explains; {extra}."
        comes = "come" if len(proxies) > 1 else "comes"
        beside = f"; for the rest {extra}" if len(proxies) < len(diagnosis.found) else ""
        closest = f"{joined(proxies)} {comes} closest, as a proxy"
        return f"The simulation lacks something that is not fully explained; {closest}{beside}."
    parts = []
    kinds = (("device", "the simulated device lacks"), ("body", "the simulated foot and ankle lack"))
    for kind, words in (*kinds, ("instrument", "an instrument is at fault:")):
        own = [term(t) for t in diagnosis.found if t.entry.kind == kind]
        if kind == "instrument":
            own += [f"quantisation of {spoken(channel)}" for channel in diagnosis.displays]
        if own:
            parts.append(f"{words} {joined(own)}")
    found = "; ".join(parts)
    if diagnosis.verdict == "ambiguous":
        others = list(dict.fromkeys(term(rival.fit.hypothesis.terms[-1]) for rival in diagnosis.rivals))
        found += f"; {joined(others, 'or')} would explain the data as well, and they cannot tell which it is"
    return f"{found[0].upper()}{found[1:]}."


def equation(diagnosis: Diagnosis) -> str:
    """In which of the device's equations something is missing, in one sentence.

    '' if none does, if none could be checked, or if an instrument is at fault: they are believed here.
    """
    lacking = lacking_of(diagnosis.equations)
    if not lacking or any(term.channel for term in diagnosis.found):
        return ""
    parts = []
    for each in lacking:
        unit, si = UNITS_OF_EQUATIONS[each.name]
        parts.append(
            f"{number(each.lacks / si, 3)} {unit} rms of {QUANTITIES[unit]} are missing in {_place(each.name)}"
        )
    parts += [f"nothing is missing in {_place(each.name)}" for each in diagnosis.equations if each not in lacking]
    return f"If the instruments are right, {'; '.join(parts)}."


def _place(equation: str) -> str:
    return equation if equation.startswith("muscle") else f"the {equation}"


def improvement(diagnosis: Diagnosis) -> str:
    """What became of the gap of the channel that was worst, in one sentence; '' if nothing was fitted."""
    ratios = {channel: gap.refitted / gap.floor for channel, gap in diagnosis.gap.items() if gap.floor}
    if not ratios:
        return ""
    worst = max(ratios, key=lambda channel: ratios[channel])
    unit, si = UNITS[worst]
    own = diagnosis.gap[worst]
    shown = (own.refitted, own.after, own.floor or 0.0)
    before, after, floor = (f"{number(value / si, 3)} {unit}" for value in shown)
    where = "trials that no fit saw" if diagnosis.shown_on == "show" else "the fitted trials (none was kept back)"
    if not diagnosis.found:
        return f"On {where}, simulated and measured {spoken(worst)} differ by {before} rms; noise alone is {floor}."
    return f"On {where}, the {spoken(worst)} gap goes from {before} to {after} rms; noise alone is {floor}."
