"""Plausibility of the trials of a mechanism: hands channels, devices and numbers of the model to the checks."""

from collections.abc import Collection, Iterable, Mapping, Sequence

import mujoco
import numpy as np

from klute_sim.datasets import unit_conversion
from klute_sim.datasets.channels import TIME_COLUMN, MechanismChannels
from klute_sim.datasets.checks import build_simulation, collect_samples, compute_device_limits
from klute_sim.datasets.mechanism import DatasetMechanism
from klute_sim.datasets.mechanism_channels import QUANTITIES, normalize_name, parse_channel
from klute_sim.datasets.mechanism_load_checks import check_loads
from klute_sim.datasets.mechanism_motion import check_motion, describe_starts
from klute_sim.datasets.mechanism_paths import find_moved_tendons, list_stops, measure_paths
from klute_sim.datasets.mechanism_wraps import list_wraps
from klute_sim.datasets.trial import Trial
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.plant.callbacks import compile_model
from klute_sim.plant.mjcf.model_numbers import collect_model_numbers
from klute_sim.plausibility.bench.magnitudes import (
    check_device_channels,
    check_missing_value_codes,
    check_spikes,
)
from klute_sim.plausibility.bench.trial import SI_UNITS, Channel, RecordedTrial
from klute_sim.plausibility.finding import Finding, TrialFindings, are_accepted
from klute_sim.plausibility.gravity import check_gravity
from klute_sim.plausibility.joint_angle import check_joint_angle
from klute_sim.plausibility.mechanism import check_stuck_joint, check_tendon_pressures
from klute_sim.plausibility.model_numbers import ModelSize, check_model_sizes, check_reach
from klute_sim.plausibility.samples import Samples
from klute_sim.plausibility.slide_position import check_slide_position
from klute_sim.plausibility.spikes import POSITION_UNITS, check_position
from klute_sim.plausibility.stop_unit import check_stop_unit
from klute_sim.plausibility.wrapping import Wrap, check_wrap


def find_implausible(
    mechanism: DatasetMechanism,
    trials: Sequence[Trial],
    units: Sequence[Mapping[str, str]],
    source: str,
    accepted: Collection[str],
) -> TrialFindings:
    """Return what is implausible in ``trials``; ``units`` holds the units in the headings of each.

    ``accepted`` holds names of findings that the user accepts: a model whose numbers are accepted is compared with the
    trials. Raises InputError for a channel that the dataset names as measured and that no trial has, and for pressures
    of a device without a supply.
    """
    _check_measured_channels(mechanism, trials, source)
    for trial in trials:
        _check_supplies(trial, source)
    model = compile_model(mechanism.file.make_spec())
    stops, moved_tendons = list_stops(model), find_moved_tendons(model)
    model_findings = _find_implausible_model(mechanism, model, trials)
    findings: list[Finding] = []
    by_tendon: dict[str, list[RecordedTrial]] = {tendon: [] for tendon in mechanism.devices}
    for trial, trial_units in zip(trials, units, strict=True):
        samples = collect_samples(trial, trial_units, mechanism.channels)
        devices = {}
        for tendon, channels in _list_device_channels(trial, samples).items():
            described = _describe(trial.name, trial.devices[tendon], channels, trial_units)
            codes, device_trial = check_missing_value_codes(described)
            spikes, device_trial = check_spikes(device_trial)
            findings += [*codes, *spikes, *check_device_channels(device_trial)]
            if trial.devices[tendon].parameters.supply.command_is_opening == 0.0:
                devices[tendon] = device_trial
                by_tendon[tendon].append(device_trial)
        first_device, other_channels = next(iter(trial.devices.values())), _list_other_channels(trial, samples)
        codes, others = check_missing_value_codes(_describe(trial.name, first_device, other_channels, trial_units))
        findings += codes
        for name, channel in others.channels.items():
            si_unit = parse_channel(name).si_unit
            if si_unit in POSITION_UNITS:
                spikes, is_wrong = check_position(channel.samples, channel.time, si_unit, others.place)
                findings += spikes
                channel = channel.with_value(np.where(is_wrong, np.nan, channel.samples.value))
            if name.startswith(("angle_", "position_")):
                driving = [
                    driving_trial for tendon, driving_trial in devices.items() if tendon in moved_tendons.get(name, ())
                ]
                findings += _check_position(trial, channel.samples, stops.get(name), driving)
    findings += _check_stop_units(trials, units, stops, mechanism.channels)
    findings += check_tendon_pressures({tendon: recorded for tendon, recorded in by_tendon.items() if recorded})
    questioned_places = frozenset(finding.place for finding in findings)
    findings = [*model_findings, *findings]
    if are_accepted(findings, accepted):
        trusted = [
            (trial, trial_units)
            for trial, trial_units in zip(trials, units, strict=True)
            if f"trial '{trial.name}'" not in questioned_places
        ]
        devices_of_trusted = {
            tendon: [recorded_trial for recorded_trial in recorded if recorded_trial.place not in questioned_places]
            for tendon, recorded in by_tendon.items()
        }
        motion = check_motion(mechanism, trusted, devices_of_trusted, accepted)
        findings += motion
        if are_accepted(motion, accepted):
            findings += check_loads(mechanism, trusted, accepted)
    return TrialFindings(findings, questioned_places)


def describe_trials(mechanism: DatasetMechanism | None, trials: Sequence[Trial]) -> list[str]:
    """Return remarks about ``trials`` of a ``mechanism`` that lack a measured channel or begin at another zero."""
    if mechanism is None:
        return []
    remarks = []
    for name in mechanism.channels.measured:
        lacking = [f"'{trial.name}'" for trial in trials if name not in trial.measured]
        if lacking:
            noun, verb = ("trial", "has") if len(lacking) == 1 else ("trials", "have")
            more = f" and {len(lacking) - 5} more" if len(lacking) > 5 else ""
            remarks.append(
                f"{noun} {', '.join(lacking[:5])}{more} {verb} no column for the measured channel '{name}', and "
                "can show nothing about it"
            )
    return [*remarks, *describe_starts(mechanism, trials)]


def _check_measured_channels(mechanism: DatasetMechanism, trials: Sequence[Trial], source: str) -> None:
    for name in mechanism.channels.measured:
        if not any(name in trial.measured for trial in trials):
            raise InputError(
                f"{source}: no trial has the measured channel '{name}'; add its column to the files, name the column "
                "in [columns], or remove the channel from 'measured'"
            )


def _check_supplies(trial: Trial, source: str) -> None:
    for tendon, device in trial.devices.items():
        command, pressure = (f"{quantity}_{normalize_name(tendon)}" for quantity in ("pressure_command", "pressure"))
        prescribed = [trial.prescribed[name] for name in (command, pressure) if name in trial.prescribed]
        has_pressures = pressure in trial.measured or any(series.value.any() for series in prescribed)
        if device.spec.supply is None and has_pressures:
            raise InputError(
                f"{source}, trial '{trial.name}': there are pressures of tendon '{tendon}', but its device "
                f"'{device.name}' has no [supply]; add it to the device file, or write 0 for the prescribed pressure "
                "and remove the measured one"
            )


def _check_position(
    trial: Trial, samples: Samples, stops: tuple[float, float] | None, driving: Sequence[RecordedTrial]
) -> list[Finding]:
    """Return what is implausible in the position of a joint; ``driving`` are the devices that move it."""
    place = f"trial '{trial.name}'"
    if stops is not None and samples.channel.startswith("angle_"):
        findings = check_joint_angle(samples.channel, samples.value, samples.unit, stops, place)
        if findings:
            return findings
    if stops is not None and samples.channel.startswith("position_"):
        findings = check_slide_position(samples, stops, place)
        if findings:
            return findings
    if samples.channel not in trial.measured:
        return []
    return check_stuck_joint(samples, driving, stops, place)


def _check_stop_units(
    trials: Sequence[Trial],
    units: Sequence[Mapping[str, str]],
    stops: Mapping[str, tuple[float, float]],
    channels: MechanismChannels,
) -> list[Finding]:
    """Return findings for hinges whose stops are in degrees that the model takes for radians."""
    findings = []
    for name in (name for name in (*channels.prescribed, *channels.measured) if name.startswith("angle_")):
        recorded = [
            (f"trial '{trial.name}'", samples[name])
            for trial, trial_units in zip(trials, units, strict=True)
            if name in (samples := collect_samples(trial, trial_units, channels))
        ]
        if recorded and name in stops:
            findings += check_stop_unit([samples for _, samples in recorded], stops[name], recorded[0][0])
    return findings


def _list_device_channels(trial: Trial, samples: Mapping[str, Samples]) -> dict[str, dict[str, Channel]]:
    """Return tendon -> channels of its device, under their names on a bench."""
    series = {**trial.prescribed, **trial.measured}
    channels_by_tendon = {}
    for tendon in trial.devices:
        names = {name: f"{name}_{normalize_name(tendon)}" for name in SI_UNITS if name != "length"}
        if names["pressure_command"] not in samples:  # a prescribed pressure takes the place of the command
            names["pressure_command"] = names.pop("pressure")
        if names["pressure_command"] in samples:  # the preparation of the trial reports a missing one
            channels_by_tendon[tendon] = {
                name: Channel(series[tendon_name].time, samples[tendon_name])
                for name, tendon_name in names.items()
                if tendon_name in samples
            }
    return channels_by_tendon


def _list_other_channels(trial: Trial, samples: Mapping[str, Samples]) -> dict[str, Channel]:
    """Return the channels that belong to no device."""
    series = {**trial.prescribed, **trial.measured}
    return {
        name: Channel(series[name].time, channel_samples)
        for name, channel_samples in samples.items()
        if QUANTITIES[parse_channel(name).quantity].object_kind != "device"
    }


def _describe(name: str, device: Device, channels: Mapping[str, Channel], units: Mapping[str, str]) -> RecordedTrial:
    time_unit = units[TIME_COLUMN]
    return RecordedTrial(
        name=name,
        channels=channels,
        limits=compute_device_limits(device),
        simulate=build_simulation(device),
        time_unit=(time_unit, unit_conversion.get_si_factor(time_unit, "s") or 1.0),
    )


def _find_implausible_model(
    mechanism: DatasetMechanism, model: mujoco.MjModel, trials: Iterable[Trial]
) -> list[Finding]:
    """Return what is implausible in the numbers of the ``model``, which trials may change."""
    size = ModelSize(float(model.stat.extent), float(model.body_mass.sum()))
    declared = collect_model_numbers(mechanism.file.make_spec())
    gravity_of_file = [declared[f"model.option.gravity_{axis}"] for axis in "xyz"]
    findings: list[Finding] = []
    paths: dict[tuple[tuple[str, float], ...], dict[str, tuple[float, float]]] = {}
    wraps: dict[tuple[tuple[str, float], ...], list[Wrap]] = {}
    for trial in trials:
        place, numbers = f"trial '{trial.name}'", {**declared, **trial.model_numbers}
        findings += check_gravity([numbers[f"model.option.gravity_{axis}"] for axis in "xyz"], place, gravity_of_file)
        too_large = check_model_sizes(trial.model_numbers, size, place)
        findings += too_large
        if too_large:
            continue
        key = tuple(trial.model_numbers.items())
        if key not in paths:
            changed = mechanism.compile_model(trial.model_numbers)
            paths[key] = {} if changed is None else measure_paths(changed, [*mechanism.devices])
            wraps[key] = [] if changed is None else list_wraps(changed, [*mechanism.devices])
        for tendon, path in paths[key].items():
            parameters = trial.devices[tendon].parameters
            unit_length = parameters.muscle.resting_length + parameters.tendon.slack_length
            findings += check_reach(tendon, path, unit_length, place)
        findings += [finding for wrap in wraps[key] for finding in check_wrap(wrap, place)]
    return findings
