"""A hypothesis: the device with its uncertain values, additional effects, and the parameters to fit.

Parameters are normalized. An uncertain value of the device is measured in standard deviations from its nominal value.
A parameter of an effect is measured in typical sizes from its neutral value, or, if it has no neutral value, by the
natural logarithm of its ratio to the typical value.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from klute_sim.datasets.mechanism import DEVICE_SEPARATOR, carry_error, is_model_number
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.device.schema.document import DeviceSpec
from klute_sim.diagnosis.experiments.base import (
    CHANNEL_UNITS,
    BodyEdit,
    Experiment,
    NumberChange,
    SensorModel,
    SimulationSetup,
)
from klute_sim.diagnosis.experiments.registration import PLATE_GAIN, REGISTRATION_PREFIX, make_registration
from klute_sim.diagnosis.fitting.dependent_numbers import (
    complete_numbers,
    derive_numbers,
    limit_number,
    move_mounting,
    replace_values,
    shift_length,
)
from klute_sim.diagnosis.fitting.number_error import (
    BOUND_SIGMAS,
    FORM_WORDS,
    LENGTH_ZERO,
    compute_plausible_error,
    make_number_effect,
)
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect, EffectForm, EffectParameter
from klute_sim.parameters import Parameter
from klute_sim.plant.mjcf.model_effects import ModelEffect
from klute_sim.types import Array

Identity = tuple[str | None, ...]
"""What a term stands for, whatever its form: effect, channel, number, tendon, part and specimen."""
PRIOR_BOUND_SIGMAS = 3.0
"""Bounds of an uncertain device value, in standard deviations from its nominal value (assumed)."""


class EffectTerm(NamedTuple):
    """An effect in one of its forms; for an instrument effect, on one channel."""

    effect: str
    """Name of the effect in the catalogue."""
    form: str
    """Name of the form."""
    channel: str | None = None
    """Measured channel of an instrument effect; None for other effects."""
    parameter_keys: tuple[str, ...] = ()
    """Keys of the fitted parameters of a data-driven term, whose other parameters stay neutral; empty: all."""
    number: str | None = None
    """``section.key`` of the device file for an error of this number; None for effects."""
    tendon: str | None = None
    """Tendon of the only device of a mechanism that has the effect; None: all devices have it."""
    part: str | None = None
    """Joint or pulley of a mechanism that has the effect; None for other effects."""
    specimen: str | None = None
    """The only specimen whose number is wrong; None: that of all specimens is."""
    declared: float | None = None
    """The number that the file states for this specimen, in its unit; None where there is none."""

    @property
    def identity(self) -> Identity:
        """What the term stands for, whatever its form."""
        return self.effect, self.channel, self.number, self.tendon, self.part, self.specimen

    @property
    def owner(self) -> str | None:
        """The channel, tendon or part that has the effect; None where all have it."""
        return self.channel or self.tendon or self.part

    @property
    def qualified_name(self) -> str:
        """The effect with its number or owner, as in ``verdict.json`` and for ``--exclude``."""
        owner = self.number or self.owner
        name = f"{self.effect}@{owner}" if owner else self.effect
        return f"{name}@{self.specimen}" if self.specimen else name

    @property
    def effect_definition(self) -> Effect:
        """The effect in the catalogue, or the error of a number in the same shape."""
        return make_number_effect(self.number) if self.number else catalogue.get_effects()[self.effect]

    @property
    def form_definition(self) -> EffectForm:
        """The form of the effect."""
        if self.number:
            return next(form for form in self.effect_definition.forms if form.name == self.form)
        return catalogue.find_form(self.effect, self.form)[1]

    @property
    def parameters(self) -> tuple[EffectParameter, ...]:
        """The fitted parameters."""
        return tuple(
            p for p in self.form_definition.parameters if not self.parameter_keys or p.key in self.parameter_keys
        )

    def __str__(self) -> str:
        """Return effect, form (where there are several) and owner, or the number that may be wrong."""
        if self.number:
            form = FORM_WORDS.get(self.form, "")
            return f"{self.number}{form} of specimen '{self.specimen}'" if self.specimen else f"{self.number}{form}"
        owner = f" of {self.owner}" if self.owner else ""
        if len(self.effect_definition.forms) == 1:
            return f"{self.effect}{owner}"
        return f"{self.effect} ({self.form}){owner}"


@dataclass(frozen=True, kw_only=True)
class FitParameter(Parameter):
    """A parameter that is fitted; its name is the key in the device file or that of the effect's parameter."""

    term_index: int | None
    """Index of the hypothesis' term that it belongs to; None for a device value."""


@dataclass(frozen=True)
class Hypothesis:
    """The device with its uncertain values and additional effects."""

    device: Device
    """Nominal device."""
    uncertainties: tuple[tuple[str, float], ...]
    """Key of each uncertain value in the device file, and its standard deviation."""
    noise_std: tuple[tuple[str, float], ...]
    """Channel and standard deviation of its noise [SI], the unit of an instrument's offset and drift."""
    terms: tuple[EffectTerm, ...] = ()
    """Additional effects."""
    registration: tuple[tuple[str, float], ...] = ()
    """Name and standard deviation of each error of the registration."""
    rig_numbers: tuple[tuple[str, float], ...] = ()
    """Name and nominal value of each number beside those of the device that may be fitted: of a mechanism's model, of
    one of its devices, or of a bench."""

    def with_term(self, term: EffectTerm) -> "Hypothesis":
        """Return the hypothesis with ``term`` added."""
        return replace(self, terms=(*self.terms, term))

    def without_term(self, term: EffectTerm) -> "Hypothesis":
        """Return the hypothesis without ``term``."""
        return replace(self, terms=tuple(t for t in self.terms if t != term))

    @cached_property
    def parameters(self) -> tuple[FitParameter, ...]:
        """Parameters of the device, then those of each term in order."""
        nominal_values = {**self.device.spec.collect_values(), **dict(self.rig_numbers)}
        parameters = []
        for key, deviation in self.uncertainties:
            nominal, half_range = nominal_values[key], PRIOR_BOUND_SIGMAS * deviation
            lower, upper = limit_number(key, nominal_values, half_range)
            parameters.append(
                FitParameter(name=key, term_index=None, initial=nominal, scale=deviation, lower=lower, upper=upper)
            )
        for name, deviation in self.registration:
            parameters.append(
                FitParameter(
                    name=name,
                    term_index=None,
                    initial=0.0,
                    scale=deviation,
                    lower=-PRIOR_BOUND_SIGMAS * deviation,
                    upper=PRIOR_BOUND_SIGMAS * deviation,
                )
            )
        for index, term in enumerate(self.terms):
            if term.number:
                parameters.append(self._make_number_parameter(term.number, index, term))
            else:
                parameters += [self._make_parameter(p, index, term) for p in term.parameters]
        return tuple(parameters)

    def _make_number_parameter(self, key: str, term_index: int, term: EffectTerm) -> FitParameter:
        nominal_values = {**self.device.spec.collect_values(), **dict(self.rig_numbers)}
        nominal = nominal_values[key] = nominal_values[key] if term.declared is None else term.declared
        error = compute_plausible_error(key, nominal)
        lower, upper = limit_number(key, nominal_values, BOUND_SIGMAS * error, term.form)
        return FitParameter(name=key, term_index=term_index, initial=nominal, scale=error, lower=lower, upper=upper)

    def _make_parameter(self, parameter: EffectParameter, term_index: int, term: EffectTerm) -> FitParameter:
        if parameter.neutral is None:
            return FitParameter(
                name=parameter.key,
                term_index=term_index,
                initial=parameter.typical,
                scale=1.0,
                lower=parameter.lower,
                upper=parameter.upper,
                is_logarithmic=True,
            )
        scale = parameter.typical - parameter.neutral
        if term.channel is not None and not math.isfinite(parameter.upper):
            scale *= dict(self.noise_std)[term.channel] / CHANNEL_UNITS[term.channel][1]
        return FitParameter(
            name=parameter.key,
            term_index=term_index,
            initial=parameter.neutral,
            scale=scale,
            lower=parameter.lower,
            upper=parameter.upper,
        )

    @property
    def n_prior_parameters(self) -> int:
        """Number of declared uncertain numbers and registration errors.

        They come first and have normal priors of standard deviation 1, whose mean is 0 except for a gain of noisy
        inputs (:meth:`~klute_sim.diagnosis.fitting.weighted_data.WeightedData.compute_prior_residuals`).
        """
        return len(self.uncertainties) + len(self.registration)

    @property
    def input_gains(self) -> Array:
        """Relative change of the mechanical input per standard deviation of each prior parameter.

        Only the gain of the force plate changes it in proportion.
        """
        priors = self.parameters[: self.n_prior_parameters]
        return np.array([0.01 * p.scale if p.name == PLATE_GAIN else 0.0 for p in priors], dtype=np.float64)

    def initial_point(self) -> Array:
        """Return the normalized parameters of the nominal device with neutral effects: (parameters,) of 0."""
        return np.zeros(len(self.parameters))

    def values(self, x: Array) -> list[float]:
        """Return the parameter values at normalized parameters ``x`` (parameters,), each in its own unit."""
        return [p.denormalize(float(x_p)) for p, x_p in zip(self.parameters, x, strict=True)]

    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds of the normalized parameters, (parameters,) each."""
        bounds = np.array([p.bounds for p in self.parameters]).reshape(-1, 2)
        return bounds[:, 0], bounds[:, 1]

    def collect_numbers(self, values: Sequence[float]) -> dict[str, float]:
        """Return ``section.key`` -> fitted number of the device for parameter ``values``, each in its own unit.

        An uncertain number may be wrong by more than its declared uncertainty; then its two changes add. Numbers that
        are wrong for one specimen are not those of the device.
        """
        other_names, numbers = dict(self.rig_numbers), dict[str, float]()
        for parameter, value in zip(self.parameters, values, strict=True):
            is_number = (
                not parameter.name.startswith(REGISTRATION_PREFIX)
                if parameter.term_index is None
                else self._is_number_of_device(self.terms[parameter.term_index])
            )
            if is_number and parameter.name not in other_names:
                shift = numbers.get(parameter.name, parameter.initial) - parameter.initial
                numbers[parameter.name] = value + shift
        return numbers

    @staticmethod
    def _is_number_of_device(term: EffectTerm) -> bool:
        return term.number is not None and term.specimen is None

    def collect_rig_numbers(self, values: Sequence[float]) -> dict[str, float]:
        """Return name -> fitted one of :attr:`rig_numbers` for parameter ``values``, each in its own unit."""
        names = dict(self.rig_numbers)
        return {p.name: v for p, v in zip(self.parameters, values, strict=True) if p.name in names}

    def build_setups(self, x: Array, experiments: Sequence[Experiment]) -> list[SimulationSetup]:
        """Return the simulation setup of each of ``experiments`` at normalized parameters ``x``."""
        values = self.values(x)
        device_effects: list[tuple[EffectTerm, dict[str, float]]] = []
        sensors, body_edits, model_effects = [], [], []
        for index, term in enumerate(self.terms):
            if term.number:
                continue
            pairs = [(p, v) for p, v in zip(self.parameters, values, strict=True) if p.term_index == index]
            if term.effect_definition.kind == "mechanism" and term.channel is None:
                values_by_key = tuple((p.name, v) for p, v in pairs)
                model_effects.append(ModelEffect(term.effect, term.form, values_by_key, term.part))
            elif term.effect_definition.kind == "body":
                body_edits.append(BodyEdit(term.effect, term.form, tuple((p.name, v) for p, v in pairs)))
            elif term.channel is None:
                device_effects.append((term, {p.name: v for p, v in pairs}))
            else:
                form, unit = term.form_definition, CHANNEL_UNITS[term.channel][1]
                si_values = tuple(v * unit if not math.isfinite(p.upper) else v for p, v in pairs)
                sensors.append(SensorModel(term.channel, term.effect, form.name, form.parameter_type(*si_values)))
        errors = values[len(self.uncertainties) : self.n_prior_parameters]
        registration = make_registration(zip(dict(self.registration), errors, strict=True))
        # Most trials share a device.
        built: dict[tuple[str | None, str, str], tuple[DeviceParameters, list[BodyEdit]]] = {}
        specimens = {term.specimen for term in self.terms}
        length_zero = 1e-3 * self.collect_rig_numbers(values).get(LENGTH_ZERO, 0.0)

        def build(device: Device, tendon: str | None, specimen: str) -> tuple[DeviceParameters, list[BodyEdit]]:
            key = tendon, device.digest, specimen if specimen in specimens else ""
            if key not in built:
                corrected = self.correct_numbers(device, tendon, values, specimen)
                spec = replace_values(device.spec, corrected)
                added = {(t.effect, t.form): p for t, p in device_effects if t.tendon in (None, tendon)}
                effects = catalogue.pack_effects(_select_effects(spec, "device") | added)
                parameters = shift_length(spec.to_parameters(), length_zero)._replace(effects=effects)
                if experiments[0].has_body:
                    parameters = move_mounting(parameters, device.spec, spec)
                built[key] = parameters, _collect_body_edits(spec, corrected)
            return built[key]

        declared = dict(self.rig_numbers)
        changes = {n: NumberChange(declared[n], v) for n, v in self.collect_model_numbers(values).items()}
        setups = []
        for experiment in experiments:
            imperfect = tuple(sensor for sensor in sensors if sensor.channel not in experiment.trusted)
            parameters, own_body_edits = build(experiment.device, None, experiment.specimen)
            setups.append(
                SimulationSetup(
                    parameters,
                    imperfect,
                    (*own_body_edits, *body_edits),
                    registration,
                    tuple(build(device, tendon, "")[0] for tendon, device in experiment.devices.items()),
                    tuple(experiment.correct_model_numbers(changes).items()),
                    tuple(model_effects),
                )
            )
        return setups

    def correct_numbers(
        self, device: Device, tendon: str | None, values: Sequence[float], specimen: str | None = None
    ) -> dict[str, float]:
        """Return ``section.key`` -> number of ``device`` on ``tendon`` (None: no mechanism) at parameter ``values``.

        A number that a trial or a tendon overrides has the error of that of the dataset's device (:func:`carry_error`).
        An error of the device on one tendon, or of ``specimen`` (None: none in particular), is added to those of all.
        """
        nominal, declared_values = self.device.spec.collect_values(), device.spec.collect_values()
        corrected = {
            key: carry_error(key, nominal[key], value, declared_values[key])
            for key, value in self.collect_numbers(values).items()
            if key in declared_values
        }
        declared = dict(self.rig_numbers)
        for name, value in self.collect_rig_numbers(values).items():
            owner, separator, key = name.rpartition(DEVICE_SEPARATOR)
            if separator and owner == tendon:
                corrected[key] = corrected.get(key, declared_values[key]) + value - declared[name]
        for parameter, value in zip(self.parameters, values, strict=True):
            term = None if parameter.term_index is None else self.terms[parameter.term_index]
            if term is not None and term.specimen is not None and term.specimen == specimen:
                corrected[parameter.name] = corrected.get(parameter.name, declared_values[parameter.name])
                corrected[parameter.name] += value - parameter.initial
        wrong = set()
        for term in self.terms:
            owner, _, key = (term.number or "").rpartition(DEVICE_SEPARATOR)
            if key and owner in ("", tendon) and term.specimen in (None, specimen):
                wrong.add(key)
        derived = derive_numbers(declared_values, corrected, {term.form for term in self.terms})
        return complete_numbers(declared_values, corrected | derived, wrong | derived.keys())

    def list_fitted_keys(self, tendon: str | None) -> set[str]:
        """Return ``section.key`` of all fitted numbers of the device on ``tendon`` (None: no mechanism)."""
        initial = [p.initial for p in self.parameters]
        names = (name.rpartition(DEVICE_SEPARATOR) for name in self.collect_rig_numbers(initial))
        shared = self.collect_numbers(initial)
        return {*shared, *(key for owner, separator, key in names if separator and owner == tendon)}

    def collect_model_numbers(self, values: Sequence[float]) -> dict[str, float]:
        """Return name -> fitted number of the model of a mechanism for parameter ``values``."""
        return {name: v for name, v in self.collect_rig_numbers(values).items() if is_model_number(name)}


def _select_effects(spec: DeviceSpec, kind: str) -> dict[tuple[str, str], dict[str, float]]:
    """Return the device's own effects of ``kind``; their fitted values are not checked against the limits."""
    selected = {}
    for name, content in spec.effects.items():
        if catalogue.get_effects()[name].kind != kind:
            continue
        form = catalogue.find_form(name, str(content["form"]) if "form" in content else None)[1]
        selected[name, form.name] = {p.key: float(content[p.key]) for p in form.parameters if p.key in content}
    return selected


def _collect_body_edits(spec: DeviceSpec, changed_keys: Iterable[str]) -> list[BodyEdit]:
    """Return the device's own body effects that have a value among ``changed_keys``."""
    changed = {key.split(".")[1] for key in changed_keys if key.startswith("effects.")}
    return [
        BodyEdit(effect, form, tuple(values.items()))
        for (effect, form), values in _select_effects(spec, "body").items()
        if effect in changed
    ]
