"""A hypothesis: which effects are there, and the unknown numbers that come with it.

Unknowns are counted in steps of their own size: a device's uncertain number in standard deviations from its nominal
value, an effect's in typical sizes from neutral. A shape, which has no neutral value, is counted in natural
logarithms from its typical value.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from klute_sim.device.files import Device
from klute_sim.device.schema import DeviceSpec
from klute_sim.device.step import Parameters
from klute_sim.diagnose.experiment import UNITS, Array, Edit, Experiment, Reading, Setting
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect, Form, Parameter

PRIOR_BOUND = 3.0
"""How many standard deviations an uncertain number may be away from its nominal value."""


class Term(NamedTuple):
    """An effect in one of its forms; for an instrument, on one channel."""

    effect: str
    form: str
    channel: str | None = None
    keys: tuple[str, ...] = ()
    """The parameters that are fitted, of a data-driven one; none: all. The others stay neutral."""

    @property
    def entry(self) -> Effect:
        """In the catalogue."""
        return catalogue.effects()[self.effect]

    @property
    def law(self) -> Form:
        """The form in the catalogue."""
        return catalogue.form_of(self.effect, self.form)[1]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Those that are fitted."""
        return tuple(p for p in self.law.parameters if not self.keys or p.key in self.keys)

    def __str__(self) -> str:
        """As a person would say it."""
        of = f" of {self.channel}" if self.channel else ""
        return f"{self.effect}{of}" if len(self.entry.forms) == 1 else f"{self.effect} ({self.form}){of}"


class Unknown(NamedTuple):
    """One number that is fitted."""

    key: str
    """As in the device file, or the effect's parameter."""
    term: int | None
    """Which term it belongs to; None: the device itself."""
    origin: float
    size: float
    low: float
    high: float
    """Bounds, in its own unit."""
    logarithmic: bool = False

    def value(self, steps: float) -> float:
        """In its own unit, within the bounds."""
        low, high = self.bounds  # first: what the data do not hold may be hundreds of steps away, more than exp can say
        within = min(max(steps, low), high)
        found = self.origin * math.exp(within) if self.logarithmic else self.origin + self.size * within
        return min(max(found, self.low), self.high)

    def steps(self, value: float) -> float:
        """The inverse of :meth:`value`."""
        return math.log(value / self.origin) if self.logarithmic else (value - self.origin) / self.size

    @property
    def bounds(self) -> tuple[float, float]:
        """In steps, the lower one first."""
        low, high = self.steps(self.low), self.steps(self.high)
        return (low, high) if low < high else (high, low)


@dataclass(frozen=True)
class Hypothesis:
    """The device with its uncertain numbers, and ``terms`` added to it."""

    device: Device
    uncertain: tuple[tuple[str, float], ...]
    """Key of the device file and its standard deviation."""
    noise: tuple[tuple[str, float], ...]
    """Channel and its noise [SI], by which an instrument's offset and drift are measured."""
    terms: tuple[Term, ...] = ()

    def plus(self, term: Term) -> "Hypothesis":
        """With one more term."""
        return Hypothesis(self.device, self.uncertain, self.noise, (*self.terms, term))

    def minus(self, term: Term) -> "Hypothesis":
        """Without ``term``."""
        return Hypothesis(self.device, self.uncertain, self.noise, tuple(t for t in self.terms if t != term))

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """The device's first, then every term's in turn."""
        numbers = self.device.spec.numbers()
        found = []
        for key, deviation in self.uncertain:
            nominal, reach = numbers[key], PRIOR_BOUND * deviation
            low = max(nominal - reach, 1e-3 * nominal) if nominal > 0.0 else nominal - reach
            found.append(Unknown(key, None, nominal, deviation, low, nominal + reach))
        for number, term in enumerate(self.terms):
            found += [self._unknown(p, number, term) for p in term.parameters]
        return tuple(found)

    def _unknown(self, parameter: Parameter, number: int, term: Term) -> Unknown:
        p = parameter
        if p.neutral is None:
            return Unknown(p.key, number, p.typical, 1.0, p.low, p.high, logarithmic=True)
        size = p.typical - p.neutral
        if term.channel is not None and not math.isfinite(p.high):
            size *= dict(self.noise)[term.channel] / UNITS[term.channel][1]
        return Unknown(p.key, number, p.neutral, size, p.low, p.high)

    @property
    def base(self) -> int:
        """How many of the unknowns are the device's."""
        return len(self.uncertain)

    def start(self) -> Array:
        """Nominal device, neutral effects, typical shapes."""
        return np.zeros(len(self.unknowns))

    def values(self, steps: Array) -> list[float]:
        """The unknowns in their own units."""
        return [u.value(float(s)) for u, s in zip(self.unknowns, steps, strict=True)]

    def bounds(self) -> tuple[Array, Array]:
        """Of the unknowns, in steps."""
        both = np.array([u.bounds for u in self.unknowns]).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def settings(self, steps: Array, experiments: Sequence[Experiment]) -> list[Setting]:
        """What to simulate in each of ``experiments``."""
        values = self.values(steps)
        active: dict[tuple[str, str], dict[str, float]] = {}
        readings, added = [], []
        for number, term in enumerate(self.terms):
            own = [(u, v) for u, v in zip(self.unknowns, values, strict=True) if u.term == number]
            if term.entry.kind == "body":
                added.append(Edit(term.effect, term.form, tuple((u.key, v) for u, v in own)))
            elif term.channel is None:
                active[term.effect, term.form] = {u.key: v for u, v in own}
            else:
                unit = UNITS[term.channel][1]
                si = tuple(v * unit if not math.isfinite(u.high) else v for u, v in own)
                readings.append(Reading(term.channel, term.effect, si))
        found = dict(zip((key for key, _ in self.uncertain), values, strict=False))
        nominal = self.device.spec.numbers()
        made: dict[str, tuple[Parameters, list[Edit]]] = {}  # most trials have the same device
        result = []
        for experiment in experiments:
            device = experiment.device
            if device.digest not in made:
                # A number that a trial has of its own is wrong by the same share as the device's.
                here = device.spec.numbers()
                corrected = {
                    key: here[key] * value / nominal[key] if nominal[key] != 0.0 else here[key] + value
                    for key, value in found.items()
                }
                spec = with_numbers(device.spec, corrected)
                effects = catalogue.values(_having(spec, "device") | active)
                made[device.digest] = spec.parameters()._replace(effects=effects), _body(spec, corrected)
            faulty = tuple(each for each in readings if each.channel not in experiment.checked)
            parameters, body = made[device.digest]
            result.append(Setting(parameters, faulty, (*body, *added)))
        return result


def with_numbers(spec: DeviceSpec, numbers: Mapping[str, float]) -> DeviceSpec:
    """``spec`` with other ``numbers`` (``section.key``), not checked again."""
    sections: dict[str, dict[str, Any]] = {}
    for key, value in numbers.items():
        section, _, name = key.partition(".")
        sections.setdefault(section, {})[name] = value
    effects = sections.pop("effects", {})
    changed: dict[str, Any] = {s: getattr(spec, s).model_copy(update=update) for s, update in sections.items()}
    if effects:
        content = {name: dict(values) for name, values in spec.effects.items()}
        for path, value in effects.items():
            name, _, key = path.partition(".")
            content[name][key] = value
        changed["effects"] = content
    return spec.model_copy(update=changed)


def _having(spec: DeviceSpec, kind: str) -> dict[tuple[str, str], dict[str, float]]:
    """The effects of ``kind`` that the device itself has already; numbers that are fitted may be out of range."""
    found = {}
    for name, content in spec.effects.items():
        if catalogue.effects()[name].kind != kind:
            continue
        form = catalogue.form_of(name, str(content["form"]) if "form" in content else None)[1]
        found[name, form.name] = {p.key: float(content[p.key]) for p in form.parameters if p.key in content}
    return found


def _body(spec: DeviceSpec, corrected: Iterable[str]) -> list[Edit]:
    """The effects of the body that the device itself has, if one of their numbers is among the ``corrected`` keys."""
    changed = {key.split(".")[1] for key in corrected if key.startswith("effects.")}
    own = _having(spec, "body")
    return [Edit(*which, tuple(numbers.items())) for which, numbers in own.items() if which[0] in changed]
