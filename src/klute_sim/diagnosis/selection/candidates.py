"""Candidate effects and numbers: what a dataset may show, and what may be added to a fit."""

import math
from collections.abc import Container, Iterable, Mapping, Sequence

from klute_sim.datasets.channels import RigName
from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.mechanism import DEVICE_SEPARATOR
from klute_sim.device.device import Device
from klute_sim.device.schema.document import PNEUMATIC_SECTIONS
from klute_sim.diagnosis.data_quality import is_supply_only
from klute_sim.diagnosis.experiments.base import CHANNEL_UNITS, Experiment
from klute_sim.diagnosis.fitting.hypothesis import PRIOR_BOUND_SIGMAS, EffectTerm, Identity
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.number_error import (
    BOUND_SIGMAS,
    NUMBER_ERROR_NAME,
    SPECIMEN_NUMBERS,
    compute_plausible_error,
    list_error_candidates,
    list_model_error_candidates,
    list_rig_error_candidates,
    make_number_effect,
)
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.quantization import Quantizer
from klute_sim.effects import catalogue
from klute_sim.effects.effect import Effect
from klute_sim.effects.families import instrument
from klute_sim.errors import InputError, suggest

RIG_BY_KIND: Mapping[str, tuple[RigName, str]] = {"body": ("gait", "in gait"), "mechanism": ("mjcf", "on a mechanism")}
"""Kind of an effect that only one rig can show -> this rig, and words for it."""


def check_effect_names(dataset: Dataset, only: Sequence[str], exclude: Sequence[str]) -> None:
    """Raise InputError for an unknown effect or number, and for an effect in ``only`` that ``dataset`` cannot show.

    On a mechanism, it is enough that one of the devices may lack the effect.
    """
    devices = {} if dataset.mechanism is None else dataset.mechanism.devices
    rig_numbers = list_rig_error_candidates(dataset)
    own = dict.fromkeys([*dataset.device.spec.collect_values(), *dataset.uncertainties])
    values = [*own, *rig_numbers, *dataset.model_values]
    for name in (*only, *exclude):
        effect = name.partition("@")[0]
        if effect not in (NUMBER_ERROR_NAME, *values) and effect not in catalogue.get_effects():
            raise InputError(_describe_unknown_name(effect, values))
    for name in (name.partition("@")[0] for name in only):
        if name in (NUMBER_ERROR_NAME, *values):
            continue
        if name not in catalogue.get_named_effects():
            raise InputError(
                f"'{name}' is not a candidate effect: it is data-driven, and fitted where no effect explains the data"
            )
        rig, place = RIG_BY_KIND.get(catalogue.get_effects()[name].kind, (dataset.rig, ""))
        if dataset.rig != rig:
            raise InputError(
                f"effect '{name}' acts {place} only, and these data are of rig = '{dataset.rig}'; remove it from the "
                "names to test"
            )
        obstacles = [_explain_obstacle(name, device) for device in [*devices.values()] or [dataset.device]]
        if all(obstacles):
            raise InputError(obstacles[0])


def _explain_obstacle(name: str, device: Device) -> str:
    """Return why ``device`` cannot lack the effect ``name``; '' where it can."""
    if name in device.spec.effects:
        return (
            f"device '{device.name}' has effect '{name}' already, so it is not a candidate; remove it from the device "
            f'file, or test its numbers, named as "effects.{name}.<number>"'
        )
    incompatibility = device.spec.find_incompatibility(name)
    return f"device '{device.name}': {incompatibility}" if incompatibility else ""


def _describe_unknown_name(name: str, numbers: Sequence[str]) -> str:
    """Return a sentence that lists the effects, or the ``numbers`` where ``name`` is written as one: section.key."""
    effects = list(catalogue.get_effects())
    if "." in name:
        listing = f"the numbers are: {', '.join(numbers)}; 'klute-sim effects' lists the effects"
    else:
        listing = (
            f"the effects are: {', '.join(effects)}; numbers are named as '{numbers[0]}'. To add effects of your own, "
            "name their file with --catalogue"
        )
    return f"there is no effect or number '{name}'; {suggest(name, [*effects, *numbers], listing)}"


def list_candidate_terms(
    data: WeightedData,
    dataset: Dataset,
    only: Sequence[str] = (),
    exclude: Sequence[str] = (),
) -> list[EffectTerm]:
    """Return the effects of the catalogue that the device of ``dataset`` may lack and ``data`` may show.

    Numbers that may be wrong follow, those that are declared uncertain among them: they may be wrong by more than that
    (:func:`list_contradicted_numbers`). ``only`` and ``exclude`` are names of effects or numbers, or of an effect on
    one channel, number or tendon (``sensor_gain@force``). Raises InputError for a name with ``@``, and for any name in
    ``only``, without a candidate.
    """
    terms = _list_all_terms(data, dataset)
    # The user may also name terms that are tested elsewhere: quantisation, and numbers of single specimens.
    nameable = [*terms, *map(make_quantization_term, data.noise)]
    if dataset.rig == "bench":
        nameable += list_specimen_numbers(data.experiments, dataset.device)
    known = {term.qualified_name for term in nameable}
    for name in (*only, *exclude):
        if "@" in name and name not in known:
            hint = suggest(name, known, "klute-sim effects lists all effects")
            raise InputError(f"'{name}' is no candidate for these data; {hint}")
    for name in only:
        if not any(_is_among(term, {name}) for term in nameable):
            raise InputError(
                f"'{name}' is no candidate for these data: no part or channel of them can show it, or the device has "
                "it already, or it is fitted already; remove it from the names to test"
            )
    return select_by_name(terms, only, exclude)


def select_by_name(terms: Iterable[EffectTerm], only: Sequence[str], exclude: Sequence[str]) -> list[EffectTerm]:
    """Return those of ``terms`` that are named in ``only`` (empty: all) and not in ``exclude``."""
    return [term for term in terms if (not only or _is_among(term, only)) and not _is_among(term, exclude)]


def select_quantizers(
    quantizers: Mapping[str, Quantizer], only: Sequence[str], exclude: Sequence[str]
) -> dict[str, Quantizer]:
    """Return those of ``quantizers`` (by channel) that may be named, as :func:`select_by_name` does for other terms."""
    terms = {channel: make_quantization_term(channel) for channel in quantizers}
    return {c: quantizers[c] for c, term in terms.items() if select_by_name([term], only, exclude)}


def make_quantization_term(channel: str) -> EffectTerm:
    """Return the term for a quantized ``channel``, which is detected without a simulation."""
    effect = instrument.QUANTIZATION
    return EffectTerm(effect.name, effect.forms[0].name, channel)


def _is_among(term: EffectTerm, names: Container[str]) -> bool:
    return term.effect in names or term.qualified_name in names or (term.number is not None and term.number in names)


def list_further_terms(candidate_terms: Iterable[EffectTerm], current: Fit) -> list[EffectTerm]:
    """Return those of ``candidate_terms`` that may be added to ``current``.

    An error of a number that is declared uncertain is among them only where ``current`` contradicts the declaration,
    or where it is that of one specimen: the declared uncertainty is that of all together.
    """
    used = current.hypothesis.terms
    closed = dict(current.hypothesis.uncertainties).keys() - list_contradicted_numbers(current)
    return [
        term
        for term in candidate_terms
        if not any(is_same_cause(term, other) for other in used)
        and (term.specimen is not None or term.number not in closed)
    ]


def is_same_cause(term: EffectTerm, other: EffectTerm) -> bool:
    """Return whether two terms are one effect of one device, channel or part, or errors of one number.

    Their forms may differ. An effect of all tendons is one with that of a single tendon: a device file holds it once.
    So is a number.
    """
    (tendon, shared), (other_tendon, other_shared) = _detach_tendon(term), _detach_tendon(other)
    return shared == other_shared and (tendon == other_tendon or "" in (tendon, other_tendon))


def _detach_tendon(term: EffectTerm) -> tuple[str, Identity]:
    """Return the tendon of the only device that ``term`` changes ('' for all), and its identity without the tendon."""
    owner, _, key = (term.number or "").rpartition(DEVICE_SEPARATOR)
    return term.tendon or owner, term._replace(tendon=None, number=key or None).identity


def list_contradicted_numbers(fit: Fit) -> set[str]:
    """Return the uncertain numbers of the device that the data contradict, although their plausible errors do not.

    These end in ``fit`` at the limit of their declared uncertainty, and :data:`BOUND_SIGMAS` plausible errors reach
    beyond it.
    """
    hypothesis = fit.hypothesis
    at_limit = (
        hypothesis.parameters[index]
        for index, bound in fit.find_bounds_reached().items()
        if math.isclose(abs(bound), PRIOR_BOUND_SIGMAS)  # and not at a limit of what is possible
    )
    return {
        parameter.name
        for parameter in at_limit
        if parameter.name in hypothesis.device.spec.collect_values()
        and BOUND_SIGMAS * compute_plausible_error(parameter.name, parameter.initial)
        > PRIOR_BOUND_SIGMAS * parameter.scale
    }


def _list_all_terms(data: WeightedData, dataset: Dataset) -> list[EffectTerm]:
    device = dataset.device
    terms = []
    for effect in catalogue.get_named_effects().values():
        if is_supply_only(data.experiments) and not acts_on_pressure(effect):
            continue
        if effect.kind == "device":
            terms += list_device_terms(effect, device, data.experiments[0].devices)
        elif not device.spec.can_add_effect(effect):
            continue
        elif effect.kind == "body" and data.experiments[0].has_body:
            terms += [EffectTerm(effect.name, form.name) for form in device.spec.list_candidate_forms(effect)]
        elif effect.kind == "mechanism":
            terms += _list_mechanism_terms(effect, data.experiments[0], dataset)
        elif effect.kind == "instrument":
            # Quantisation is detected without a simulation.
            channels = [c for c in data.noise if c in CHANNEL_UNITS and effect is not instrument.QUANTIZATION]
            terms += [EffectTerm(effect.name, form.name, c) for form in effect.forms for c in channels]
    numbers = list_error_candidates(device.spec)
    if is_supply_only(data.experiments):
        numbers = {key: error for key, error in numbers.items() if key.partition(".")[0] in PNEUMATIC_SECTIONS}
    if not data.experiments[0].has_body:
        numbers = {key: error for key, error in numbers.items() if not key.startswith("mounting.")}
    model_numbers = list_model_error_candidates(dataset.model_values, frozenset(dataset.uncertainties))
    keys = (*numbers, *list_rig_error_candidates(dataset), *model_numbers)
    return terms + [
        EffectTerm(NUMBER_ERROR_NAME, form.name, number=key) for key in keys for form in make_number_effect(key).forms
    ]


def list_device_terms(effect: Effect, device: Device, devices: Mapping[str, Device]) -> list[EffectTerm]:
    """Return ``effect`` in each form that all ``devices`` (by tendon; none: ``device``) may lack, and on each tendon.

    One of several devices may have what the others lack, or what they have already.
    """
    specs = [mounted.spec for mounted in devices.values()] or [device.spec]
    terms = []
    if all(spec.can_add_effect(effect) for spec in specs):
        shared = [form for form in effect.forms if all(form in spec.list_candidate_forms(effect) for spec in specs)]
        terms = [EffectTerm(effect.name, form.name) for form in shared]
    if len(devices) > 1:
        for tendon, mounted in devices.items():
            forms = mounted.spec.list_candidate_forms(effect) if mounted.spec.can_add_effect(effect) else []
            terms += [EffectTerm(effect.name, form.name, tendon=tendon) for form in forms[:1]]
    return terms


def _list_mechanism_terms(effect: Effect, experiment: Experiment, dataset: Dataset) -> list[EffectTerm]:
    """Return ``effect`` in each form on each part of the mechanism that may have it.

    A form that is the same as a number of a joint is a candidate where this number is 0 and not fitted: elsewhere the
    number itself is fitted or tested.
    """
    parts = experiment.parts.get(effect.part, ())
    if effect.part == "position channel":
        return [EffectTerm(effect.name, form.name, channel) for form in effect.forms for channel in parts]
    terms = []
    for part in parts:
        for form in effect.forms:
            number = f"model.joint.{part}.{form.replaces_number}"
            if form.replaces_number and (dataset.model_values.get(number) or number in dataset.uncertainties):
                continue
            terms.append(EffectTerm(effect.name, form.name, part=part or None))
    return terms


def list_specimen_numbers(experiments: Sequence[Experiment], device: Device) -> list[EffectTerm]:
    """Return the errors of :data:`SPECIMEN_NUMBERS` of each specimen of ``experiments``; none where they are all one.

    ``device`` is that of the dataset; trials may override its numbers.
    """
    numbers = [key for key in list_error_candidates(device.spec) if key in SPECIMEN_NUMBERS]
    devices = {e.specimen: e.device for e in experiments}
    if len(devices) < 2:
        return []
    return [
        EffectTerm(
            NUMBER_ERROR_NAME, "value", number=key, specimen=specimen, declared=tested.spec.collect_values()[key]
        )
        for specimen, tested in devices.items()
        for key in numbers
    ]


def acts_on_pressure(effect: Effect) -> bool:
    """Return whether ``effect`` changes the pressure in the muscle, or is a fault of an instrument."""
    hooks = {hook for form in effect.forms for hook in form.laws}
    acts_on_command = not hooks or bool(hooks & {"pressure_target", "pressure_reached"})  # a dead time has no law
    return effect.acts_in_supply or effect.kind == "instrument" or acts_on_command
