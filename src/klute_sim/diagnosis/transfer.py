"""Prediction of another dataset by what a diagnosis has found: other lengths, another diameter, another specimen."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from klute_sim.datasets.dataset import Dataset, split_dataset
from klute_sim.datasets.mechanism import DEVICE_SEPARATOR, carry_error, has_arbitrary_zero, is_model_number
from klute_sim.device.device import Device
from klute_sim.diagnosis.data_quality import clean_data
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.experiments.prepare import prepare_experiments
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.hypothesis import EffectTerm, FitParameter, Hypothesis
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import list_channels
from klute_sim.diagnosis.result import Diagnosis
from klute_sim.diagnosis.transfer_prediction import (
    ChannelPrediction,
    PredictedTrial,
    TransferPrediction,
    TransferredNumber,
)
from klute_sim.errors import InputError
from klute_sim.types import Array


def check_predictable(first: Dataset, other: Dataset) -> None:
    """Raise InputError where no diagnosis of ``first`` can predict ``other``.

    This is so where the rigs differ, or where the device or the mechanism of ``other`` lacks a number that ``first``
    declares uncertain.
    """
    if other.rig != first.rig:
        raise InputError(
            f"dataset '{_get_name(other)}' was recorded on rig '{other.rig}', but the diagnosis is of rig "
            f"'{first.rig}'; allowed: the same rig"
        )
    _check_numbers(first.uncertainties, other)


def _check_numbers(names: Iterable[str], dataset: Dataset) -> None:
    """Raise InputError for one of the fitted numbers ``names`` that ``dataset`` lacks."""
    known = {*dataset.device.spec.collect_values(), *_collect_rig_numbers(dataset)}
    for name in names:
        if name not in known:
            owner = "mechanism" if is_model_number(name) or DEVICE_SEPARATOR in name else "device"
            raise InputError(
                f"the {owner} of dataset '{_get_name(dataset)}' has no number '{name}', which is fitted in the "
                f"diagnosis; declare a {owner} with the same sections and names"
            )


def _collect_rig_numbers(dataset: Dataset) -> dict[str, float]:
    return {} if dataset.mechanism is None else dataset.mechanism.collect_nominal_numbers()


def _get_name(dataset: Dataset) -> str:
    return dataset.folder.resolve().name


def predict_dataset(diagnosis: Diagnosis, dataset: Dataset, n_jobs: int = 0) -> TransferPrediction:
    """Return how well the device that ``diagnosis`` found predicts ``dataset``, without any fit to it.

    The other dataset declares its own device, which states the changes of geometry. A number that the diagnosis fitted
    keeps its *relative* change, a coordinate of the model or a temperature in °C its absolute one, because its zero is
    arbitrary. Effects of device and body are added as they were found; a parameter that changes with the muscle's
    diameter changes with the ratio of the bladder radii. Faults of instruments and errors of the registration belong to
    the first set-up and stay there.

    Dead, copied, contradicted and saturated data are not compared. Trials are predicted whatever their ``use``.

    Raises InputError when nothing was fitted, the rigs differ, the other device or model lacks a fitted number or has
    an added effect already, or no channel is usable.
    """
    if diagnosis.base_fit is None or diagnosis.final_fit is None:
        raise InputError("the diagnosis fitted nothing, so it cannot predict another dataset; see its reasons")
    check_predictable(diagnosis.dataset, dataset)
    final_hypothesis, final_x = _detach_setup(diagnosis.final_fit, dataset)
    _check_effects(final_hypothesis, dataset)
    for term in final_hypothesis.terms:
        _check_joint(term, diagnosis.dataset, dataset)
    experiments = [replace(e, use="fit") for e in prepare_experiments(dataset, split_dataset(dataset))]
    if any(e.has_zero_order_hold for e in diagnosis.experiments):
        # A command that is linear in the diagnosis has a variant with a zero-order hold.
        all_have_hold = not any(e.zero_order_hold_variant for e in diagnosis.experiments)
        experiments = [
            (e.zero_order_hold_variant or e) if all_have_hold or e.has_stepped_command else e for e in experiments
        ]
    nominal = Hypothesis(dataset.device, (), ())
    base_hypothesis, base_x = _detach_setup(diagnosis.base_fit, dataset)
    if not diagnosis.added_terms:  # the final fit is the base fit with smaller tolerances
        base_x = final_x
    ratios = _compute_diameter_ratios(diagnosis.dataset, dataset)
    final_hypothesis, final_x = _separate_tendons(final_hypothesis, final_x, ratios)
    scaled_x = _scale_parameters(final_hypothesis, final_x, ratios)
    candidates = [
        (nominal, nominal.initial_point()),
        (base_hypothesis, base_x),
        (final_hypothesis, scaled_x),
    ]
    simulator = Simulator(n_jobs)
    try:
        clean = clean_data(dataset, experiments, simulator, may_diverge=True)
        experiments = [e for e in clean.experiments if e.measured]
        if not experiments:
            raise InputError(f"dataset '{_get_name(dataset)}' cannot be predicted: {' '.join(clean.remarks)}")
        residuals = [
            WeightedData(simulator, experiments, {}).compute_residuals(hypothesis, [x], may_diverge=True)[0]
            for hypothesis, x in candidates
        ]
    finally:
        simulator.close()
    channels = {}
    for channel in list_channels(experiments):
        rms = [
            float(np.sqrt(np.mean(np.concatenate([row[channel] for row in rows if channel in row]) ** 2)))
            for rows in residuals
        ]
        channels[channel] = ChannelPrediction(rms[0], rms[1], rms[2], _compute_range(experiments, channel))
    return TransferPrediction(
        dataset_name=_get_name(dataset),
        channels=channels,
        numbers=_list_numbers(diagnosis, dataset, final_hypothesis, final_x, scaled_x, ratios),
        trials=tuple(
            PredictedTrial(
                name=e.name,
                channel=channel,
                measured=series.value,
                refitted=series.value - residuals[1][k][channel],
                with_effects=series.value - residuals[2][k][channel],
            )
            for k, e in enumerate(experiments)
            for channel, series in e.measured.items()
        ),
        remarks=tuple(clean.remarks),
    )


def _check_effects(hypothesis: Hypothesis, dataset: Dataset) -> None:
    """Raise InputError where ``dataset`` lacks the tendon of an effect, or a device of it has the effect already."""
    devices = {"": dataset.device} if dataset.mechanism is None else dataset.mechanism.devices
    for term in hypothesis.terms:
        if term.tendon is not None and term.tendon not in devices:
            raise InputError(
                f"dataset '{_get_name(dataset)}' has no tendon '{term.tendon}', whose device has the effect "
                f"'{term.effect}' in the diagnosis; tendons: {', '.join(devices)}"
            )
        for tendon, device in devices.items():
            if term.tendon not in (None, tendon):
                continue
            if term.effect in device.spec.effects:
                raise InputError(
                    f"the device '{device.name}' of dataset '{_get_name(dataset)}' has effect '{term.effect}' already, "
                    "which the prediction would add; remove it from the device file"
                )
            _check_part(term, device, dataset)


def _check_part(term: EffectTerm, device: Device, dataset: Dataset) -> None:
    """Raise InputError where ``device`` has the effect of ``term`` built in, or lacks the part that would have it."""
    if term.number or term.channel or term.effect_definition.kind != "device":
        return
    definition = term.effect_definition
    if not device.spec.can_add_effect(definition) or term.form_definition not in device.spec.list_candidate_forms(
        definition
    ):
        reason = device.spec.find_incompatibility(term.effect) or "it has no such part, or the effect is built in"
        raise InputError(
            f"the device '{device.name}' of dataset '{_get_name(dataset)}' cannot have the effect '{term.effect}' that "
            f"the diagnosis found: {reason}"
        )


def _check_joint(term: EffectTerm, first: Dataset, other: Dataset) -> None:
    """Raise InputError where a joint of ``other`` declares what ``term`` adds, and that of ``first`` does not.

    A form of friction has the number of the forms that it shares a parameter with.
    """
    if term.part is None:
        return
    keys = {parameter.key for parameter in term.form_definition.parameters}
    for form in term.effect_definition.forms:
        number = f"model.joint.{term.part}.{form.replaces_number}"
        is_same = bool(form.replaces_number) and any(parameter.key in keys for parameter in form.parameters)
        if is_same and other.model_values.get(number) and not first.model_values.get(number):
            raise InputError(
                f"the model of dataset '{_get_name(other)}' has '{number}' = {other.model_values[number]:.4g} already, "
                f"and the prediction would add the effect '{term.qualified_name}'; set the number to 0 under [numbers]"
            )


def _compute_diameter_ratios(first: Dataset, other: Dataset) -> dict[str | None, float]:
    """Return tendon (None: no mechanism) -> bladder radius declared by ``other`` over that declared by ``first`` [1].

    It is 1 without a muscle. A mechanism has an entry for None where the ratio of all tendons is the same. A tendon of
    another name than those of ``first`` is compared with the muscles of ``first``, which then must have one radius.
    """
    known: dict[str | None, Device] = {None: first.device}
    devices: dict[str | None, Device] = {None: other.device}
    if first.mechanism is not None and other.mechanism is not None:
        known, devices = dict(first.mechanism.devices.items()), dict(other.mechanism.devices.items())
    common = {_get_radius(device) for device in known.values()}
    ratios = {}
    for tendon, device in devices.items():
        if tendon not in known and len(common) > 1:
            raise InputError(
                f"dataset '{_get_name(other)}' has the tendon '{tendon}', but the diagnosis has "
                f"{', '.join(map(str, known))} with muscles of different diameters; give the tendons the same names"
            )
        radii = _get_radius(known[tendon]) if tendon in known else next(iter(common)), _get_radius(device)
        ratios[tendon] = radii[1] / radii[0] if radii[0] and radii[1] else 1.0
    if len(set(ratios.values())) == 1:
        ratios[None] = next(iter(ratios.values()))
    return ratios


def _get_radius(device: Device) -> float:
    """Return the radius of the bladder [mm]; 0 without a muscle."""
    return 0.0 if device.spec.muscle is None else device.spec.muscle.bladder_radius_mm


def _separate_tendons(hypothesis: Hypothesis, x: Array, ratios: Mapping[str | None, float]) -> tuple[Hypothesis, Array]:
    """Return ``hypothesis`` and ``x`` with one term per tendon for each that all devices have, if ``ratios`` differ.

    Only terms with a parameter that changes with the diameter are separated.
    """
    if None in ratios:
        return hypothesis, x
    terms: list[EffectTerm] = []
    n_numbers = sum(parameter.term_index is None for parameter in hypothesis.parameters)
    blocks = [x[:n_numbers]]
    for index, term in enumerate(hypothesis.terms):
        indices = [k for k, parameter in enumerate(hypothesis.parameters) if parameter.term_index == index]
        is_shared = term.tendon is None and any(
            _find_diameter_exponent(hypothesis, hypothesis.parameters[k]) for k in indices
        )
        separated = [term._replace(tendon=tendon) for tendon in ratios] if is_shared else [term]
        terms += separated
        blocks += [x[indices]] * len(separated)
    return replace(hypothesis, terms=tuple(terms)), np.concatenate(blocks)


def _scale_parameters(hypothesis: Hypothesis, x: Array, ratios: Mapping[str | None, float]) -> Array:
    """Return the normalized parameters ``x`` for muscles with ``ratios`` times the diameters."""
    scaled = x.copy()
    for index, (parameter, value) in enumerate(zip(hypothesis.parameters, hypothesis.values(x), strict=True)):
        factor = _compute_diameter_factor(hypothesis, parameter, ratios)
        if factor != 1.0:
            scaled[index] = parameter.normalize(value * factor)
    return scaled


def _compute_diameter_factor(
    hypothesis: Hypothesis, parameter: FitParameter, ratios: Mapping[str | None, float]
) -> float:
    """Return the factor by which ``parameter`` changes with the diameter [1]."""
    exponent = _find_diameter_exponent(hypothesis, parameter)
    if not exponent or parameter.term_index is None:
        return 1.0
    return float(ratios[hypothesis.terms[parameter.term_index].tendon] ** exponent)


def _find_diameter_exponent(hypothesis: Hypothesis, parameter: FitParameter) -> float:
    if parameter.term_index is None or hypothesis.terms[parameter.term_index].number:
        return 0.0
    term = hypothesis.terms[parameter.term_index]
    return next(p.diameter_exponent for p in term.parameters if p.key == parameter.name)


def _list_numbers(
    diagnosis: Diagnosis,
    other: Dataset,
    hypothesis: Hypothesis,
    x: Array,
    scaled_x: Array,
    ratios: Mapping[str | None, float],
) -> tuple[TransferredNumber, ...]:
    """Return the fitted numbers and the parameters of effects, as found and at ``scaled_x`` as used for ``other``.

    ``hypothesis`` and ``x`` are the final fit without what belongs to the first set-up.
    """
    declared = {**other.device.spec.collect_values(), **_collect_rig_numbers(other)}
    fit = diagnosis.final_fit
    assert fit is not None
    fitted_numbers = _collect_numbers(diagnosis.dataset, fit.hypothesis, fit.values)
    # A tendon of another name has the errors of the device that all tendons share.
    shared_numbers = fit.hypothesis.correct_numbers(diagnosis.dataset.device, None, fit.values)
    listed = []
    for key, used in _collect_numbers(other, hypothesis, hypothesis.values(scaled_x)).items():
        fitted = fitted_numbers.get(key, shared_numbers.get(key.rpartition(DEVICE_SEPARATOR)[2]))
        if fitted is not None:
            listed.append(TransferredNumber(key, fitted, used, _describe_rule(key, declared[key], used)))
    rows = zip(hypothesis.parameters, hypothesis.values(x), hypothesis.values(scaled_x), strict=True)
    for parameter, fitted, used in rows:
        if parameter.term_index is None or hypothesis.terms[parameter.term_index].number:
            continue
        term = hypothesis.terms[parameter.term_index]
        exponent = _find_diameter_exponent(hypothesis, parameter)
        rule = f"diameter to the power {exponent:g}" if exponent else f"as found, in {term.form_definition.equation}"
        if not np.isclose(used, fitted * _compute_diameter_factor(hypothesis, parameter, ratios)):
            rule += ", cut off at a limit of the effect"
        listed.append(TransferredNumber(f"{term.qualified_name}.{parameter.name}", fitted, used, rule))
    return tuple(listed)


def _describe_rule(key: str, declared: float, used: float) -> str:
    """Return how the number ``key`` of another dataset follows from its ``declared`` value."""
    if has_arbitrary_zero(key):
        return f"the declared {declared:.4g}, moved by as much as in the fit"
    if declared == 0.0:
        return "the declared 0, which a relative change leaves" if used == 0.0 else "as found"
    return f"the declared {declared:.4g}, changed as much as in the fit"


def _collect_numbers(dataset: Dataset, hypothesis: Hypothesis, values: Sequence[float]) -> dict[str, float]:
    """Return name -> fitted number of ``dataset``: on a mechanism those of the device on each tendon and of the model.

    The names are those of ``[uncertain]``.
    """
    if dataset.mechanism is None:
        return hypothesis.correct_numbers(dataset.device, None, values)
    numbers = {
        f"{tendon}{DEVICE_SEPARATOR}{key}": value
        for tendon, device in dataset.mechanism.devices.items()
        for key, value in hypothesis.correct_numbers(device, tendon, values).items()
    }
    return numbers | hypothesis.collect_model_numbers(values)


def _detach_setup(fit: Fit, dataset: Dataset) -> tuple[Hypothesis, Array]:
    """Return the hypothesis and the parameters of ``fit`` without instruments, registration and single specimens."""
    hypothesis = fit.hypothesis
    retained = [t.effect_definition.kind != "instrument" and t.specimen is None for t in hypothesis.terms]
    terms = tuple(term for term, keep in zip(hypothesis.terms, retained, strict=True) if keep)
    n_numbers = len(hypothesis.uncertainties)
    is_kept = [
        index < n_numbers or (parameter.term_index is not None and retained[parameter.term_index])
        for index, parameter in enumerate(hypothesis.parameters)
    ]
    detached, x = replace(hypothesis, terms=terms, registration=()), fit.x[is_kept]
    values = detached.values(x)
    _check_numbers([*detached.collect_numbers(values), *detached.collect_rig_numbers(values)], dataset)
    return _declare_rig_numbers(detached, x, dataset)


def _declare_rig_numbers(hypothesis: Hypothesis, x: Array, dataset: Dataset) -> tuple[Hypothesis, Array]:
    """Return ``hypothesis`` with the numbers of the mechanism of ``dataset``, and ``x`` with which they have the errors
    of the fit (:func:`~klute_sim.datasets.mechanism.carry_error`).
    """
    known, deviations = _collect_rig_numbers(dataset), dict(hypothesis.uncertainties)
    fitted = {parameter.name for parameter in hypothesis.parameters}
    numbers = {}
    for name, declared in hypothesis.rig_numbers:
        if name not in fitted:
            continue
        numbers[name] = known[name]
        if name in deviations:
            is_relative = declared != 0.0 and not has_arbitrary_zero(name)
            deviations[name] *= abs(known[name] / declared) if is_relative else 1.0
    carried = replace(hypothesis, uncertainties=tuple(deviations.items()), rig_numbers=tuple(numbers.items()))
    x = x.copy()
    for index, (before, after) in enumerate(zip(hypothesis.parameters, carried.parameters, strict=True)):
        if after.name in numbers:
            value = before.denormalize(float(x[index]))
            x[index] = after.normalize(carry_error(after.name, before.initial, value, after.initial))
    return carried, x


def _compute_range(experiments: list[Experiment], channel: str) -> float:
    return float(np.ptp(np.concatenate([e.measured[channel].value for e in experiments if channel in e.measured])))
