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

from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.schema.document import DeviceSpec
from klute_sim.diagnosis.experiments.base import (
    CHANNEL_UNITS,
    Array,
    BodyEdit,
    Experiment,
    SensorModel,
    SimulationSetup,
)
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect, EffectForm, EffectParameter

PRIOR_BOUND_SIGMAS = 3.0
"""How many standard deviations an uncertain number may be away from its nominal value."""


class EffectTerm(NamedTuple):
    """An effect in one of its forms; for an instrument, on one channel."""

    effect: str
    form: str
    channel: str | None = None
    parameter_keys: tuple[str, ...] = ()
    """The parameters that are fitted, of a data-driven one; none: all. The others stay neutral."""

    @property
    def effect_definition(self) -> Effect:
        """In the catalogue."""
        return catalogue.get_effects()[self.effect]

    @property
    def form_definition(self) -> EffectForm:
        """The form in the catalogue."""
        return catalogue.find_form(self.effect, self.form)[1]

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        """Those that are fitted."""
        return tuple(
            p for p in self.form_definition.parameters if not self.parameter_keys or p.key in self.parameter_keys
        )

    def __str__(self) -> str:
        """As a person would say it."""
        of = f" of {self.channel}" if self.channel else ""
        return f"{self.effect}{of}" if len(self.effect_definition.forms) == 1 else f"{self.effect} ({self.form}){of}"


class FitParameter(NamedTuple):
    """One number that is fitted."""

    key: str
    """As in the device file, or the effect's parameter."""
    term_index: int | None
    """Which term it belongs to; None: the device itself."""
    nominal: float
    scale: float
    lower: float
    upper: float
    """Bounds, in its own unit."""
    is_logarithmic: bool = False

    def denormalize(self, x: float) -> float:
        """In its own unit, within the bounds."""
        low, high = self.bounds  # first: what the data do not hold may be hundreds of steps away, more than exp can say
        within = min(max(x, low), high)
        found = self.nominal * math.exp(within) if self.is_logarithmic else self.nominal + self.scale * within
        return min(max(found, self.lower), self.upper)

    def normalize(self, value: float) -> float:
        """The inverse of :meth:`value`."""
        return math.log(value / self.nominal) if self.is_logarithmic else (value - self.nominal) / self.scale

    @property
    def bounds(self) -> tuple[float, float]:
        """In steps, the lower one first."""
        low, high = self.normalize(self.lower), self.normalize(self.upper)
        return (low, high) if low < high else (high, low)


@dataclass(frozen=True)
class Hypothesis:
    """The device with its uncertain numbers, and ``terms`` added to it."""

    device: Device
    uncertainties: tuple[tuple[str, float], ...]
    """Key of the device file and its standard deviation."""
    noise_std: tuple[tuple[str, float], ...]
    """Channel and its noise [SI], by which an instrument's offset and drift are measured."""
    terms: tuple[EffectTerm, ...] = ()

    def with_term(self, term: EffectTerm) -> "Hypothesis":
        """With one more term."""
        return Hypothesis(self.device, self.uncertainties, self.noise_std, (*self.terms, term))

    def without_term(self, term: EffectTerm) -> "Hypothesis":
        """Without ``term``."""
        return Hypothesis(self.device, self.uncertainties, self.noise_std, tuple(t for t in self.terms if t != term))

    @cached_property
    def parameters(self) -> tuple[FitParameter, ...]:
        """The device's first, then every term's in turn."""
        numbers = self.device.spec.collect_values()
        found = []
        for key, deviation in self.uncertainties:
            nominal, reach = numbers[key], PRIOR_BOUND_SIGMAS * deviation
            low = max(nominal - reach, 1e-3 * nominal) if nominal > 0.0 else nominal - reach
            found.append(FitParameter(key, None, nominal, deviation, low, nominal + reach))
        for number, term in enumerate(self.terms):
            found += [self._make_parameter(p, number, term) for p in term.parameters]
        return tuple(found)

    def _make_parameter(self, parameter_spec: EffectParameter, term_index: int, term: EffectTerm) -> FitParameter:
        p = parameter_spec
        if p.neutral is None:
            return FitParameter(p.key, term_index, p.typical, 1.0, p.lower, p.upper, is_logarithmic=True)
        size = p.typical - p.neutral
        if term.channel is not None and not math.isfinite(p.upper):
            size *= dict(self.noise_std)[term.channel] / CHANNEL_UNITS[term.channel][1]
        return FitParameter(p.key, term_index, p.neutral, size, p.lower, p.upper)

    @property
    def n_device_parameters(self) -> int:
        """How many of the unknowns are the device's."""
        return len(self.uncertainties)

    def initial_point(self) -> Array:
        """Nominal device, neutral effects, typical shapes."""
        return np.zeros(len(self.parameters))

    def values(self, x: Array) -> list[float]:
        """The unknowns in their own units."""
        return [u.denormalize(float(s)) for u, s in zip(self.parameters, x, strict=True)]

    def bounds(self) -> tuple[Array, Array]:
        """Of the unknowns, in steps."""
        both = np.array([u.bounds for u in self.parameters]).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def build_setups(self, x: Array, experiments: Sequence[Experiment]) -> list[SimulationSetup]:
        """What to simulate in each of ``experiments``."""
        values = self.values(x)
        active: dict[tuple[str, str], dict[str, float]] = {}
        readings, added = [], []
        for number, term in enumerate(self.terms):
            own = [(u, v) for u, v in zip(self.parameters, values, strict=True) if u.term_index == number]
            if term.effect_definition.kind == "body":
                added.append(BodyEdit(term.effect, term.form, tuple((u.key, v) for u, v in own)))
            elif term.channel is None:
                active[term.effect, term.form] = {u.key: v for u, v in own}
            else:
                unit = CHANNEL_UNITS[term.channel][1]
                si = tuple(v * unit if not math.isfinite(u.upper) else v for u, v in own)
                readings.append(SensorModel(term.channel, term.effect, si))
        found = dict(zip((key for key, _ in self.uncertainties), values, strict=False))
        nominal = self.device.spec.collect_values()
        made: dict[str, tuple[DeviceParameters, list[BodyEdit]]] = {}  # most trials have the same device
        result = []
        for experiment in experiments:
            device = experiment.device
            if device.digest not in made:
                # A number that a trial has of its own is wrong by the same share as the device's.
                here = device.spec.collect_values()
                corrected = {
                    key: here[key] * value / nominal[key] if nominal[key] != 0.0 else here[key] + value
                    for key, value in found.items()
                }
                spec = replace_values(device.spec, corrected)
                effects = catalogue.pack_effects(_select_effects(spec, "device") | active)
                made[device.digest] = (
                    spec.to_parameters()._replace(effects=effects),
                    _collect_body_edits(spec, corrected),
                )
            faulty = tuple(each for each in readings if each.channel not in experiment.trusted)
            parameters, body = made[device.digest]
            result.append(SimulationSetup(parameters, faulty, (*body, *added)))
        return result


def replace_values(spec: DeviceSpec, new_values: Mapping[str, float]) -> DeviceSpec:
    """``spec`` with other ``numbers`` (``section.key``), not checked again."""
    sections: dict[str, dict[str, Any]] = {}
    for key, value in new_values.items():
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


def _select_effects(spec: DeviceSpec, kind: str) -> dict[tuple[str, str], dict[str, float]]:
    """The effects of ``kind`` that the device itself has already; numbers that are fitted may be out of range."""
    found = {}
    for name, content in spec.effects.items():
        if catalogue.get_effects()[name].kind != kind:
            continue
        form = catalogue.find_form(name, str(content["form"]) if "form" in content else None)[1]
        found[name, form.name] = {p.key: float(content[p.key]) for p in form.parameters if p.key in content}
    return found


def _collect_body_edits(spec: DeviceSpec, changed_keys: Iterable[str]) -> list[BodyEdit]:
    """The effects of the body that the device itself has, if one of their numbers is among the ``corrected`` keys."""
    changed = {key.split(".")[1] for key in changed_keys if key.startswith("effects.")}
    own = _select_effects(spec, "body")
    return [BodyEdit(*which, tuple(numbers.items())) for which, numbers in own.items() if which[0] in changed]
