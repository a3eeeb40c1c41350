"""Plausibility of the trials of a dataset: hands their channels and their devices to the checks."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

import numpy as np

from klute_sim.datasets import unit_conversion
from klute_sim.datasets.channels import (
    MAX_MOTION_INTERVAL,
    MOTION_CHANNELS,
    TIME_COLUMN,
    ChannelSource,
    get_column_units,
)
from klute_sim.datasets.mechanism import DEVICE_SEPARATOR
from klute_sim.datasets.trial import Trial, TrialChannels
from klute_sim.device.device import Device
from klute_sim.device.dynamics import compute_muscle_force
from klute_sim.device.equilibrium import compute_equilibrium_state, compute_taut_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.errors import InputError, KluteSimError
from klute_sim.laws.mckibben import lock_length
from klute_sim.plausibility.bench.check import check_bench_trials
from klute_sim.plausibility.bench.trial import SI_UNITS, Channel, DeviceLimits, RecordedTrial, Response, Simulate
from klute_sim.plausibility.device_numbers import check_device_numbers
from klute_sim.plausibility.finding import Finding, TrialFindings, check_accepted_names
from klute_sim.plausibility.gait.device import check_walk_device
from klute_sim.plausibility.gait.positions import ScaledSeries
from klute_sim.plausibility.gait.steps import Series
from klute_sim.plausibility.gait.trial import GAIT_CHANNELS, GaitChannels, find_trial_findings
from klute_sim.plausibility.gravity import GRAVITY_NAME
from klute_sim.plausibility.samples import Samples
from klute_sim.types import Array

MAX_CLOCK_ERROR = 0.01
"""Largest relative error of the interval between samples that clocks and rounded times have (assumed)."""

SUPPLY_SPEEDS = "supply.rate_bar_per_s", "valve.fill_dm3_per_s_bar", "valve.exhaust_dm3_per_s_bar"
"""Numbers that are proportional to the speed of a supply."""


def find_implausible(
    rig: ChannelSource, trials: Sequence[Trial], contents: Sequence[TrialChannels], accepted: Collection[str]
) -> TrialFindings:
    """Return what is implausible in ``trials`` of a bench or gait; ``contents`` holds what was read from their files.

    ``accepted`` holds names of findings that the user accepts. Of a device that is commanded by valve opening, only the
    motion and the loads of gait trials are examined.
    """
    if rig == "bench":
        return check_bench_trials(
            [
                _describe_trial(trial, content, rig)
                for trial, content in zip(trials, contents, strict=True)
                if not _is_commanded_by_opening(trial)
            ],
            accepted,
        )
    findings: list[Finding] = []
    device_findings: list[Finding] = []
    for trial, content in zip(trials, contents, strict=True):
        walk = _describe_gait_trial(trial, content.units)
        trial_findings = find_trial_findings(walk)
        findings += trial_findings
        if not _is_commanded_by_opening(trial):
            device_findings += check_walk_device(_describe_trial(trial, content, rig), None if trial_findings else walk)
    findings += device_findings
    return TrialFindings(findings, frozenset(finding.place for finding in findings))


def _is_commanded_by_opening(trial: Trial) -> bool:
    return trial.device.parameters.supply.command_is_opening != 0.0


def check_supply(trial: Trial, source: str) -> None:
    """Raise InputError where ``trial`` of a bench or gait has pressures, but its device has no supply."""
    if trial.device.spec.supply is not None:
        return
    if "pressure" in trial.measured or trial.prescribed["pressure_command"].value.any():
        raise InputError(
            f"{source}, trial '{trial.name}': there are pressures, but device '{trial.device.name}' has no [supply]; "
            "add it to the device file, or remove the columns 'pressure' and 'pressure_command'"
        )


def check_motion_rate(trial: Trial, source: str) -> None:
    """Raise InputError where the motion of a gait ``trial`` has too few samples a second for a replay."""
    for name in MOTION_CHANNELS:
        interval = trial.prescribed[name].sampling_interval
        if interval > (1.0 + MAX_CLOCK_ERROR) * MAX_MOTION_INTERVAL:
            raise InputError(
                f"{source}, trial '{trial.name}': '{name}' has {1.0 / interval:.3g} samples a second; a replay needs "
                f"{1.0 / MAX_MOTION_INTERVAL:.0f} or more, because the acceleration of the ankle moves the foot; "
                "export the motion at the rate of the cameras"
            )


def check_accepted(
    names: Iterable[str], findings: Iterable[Finding], rig: ChannelSource, numbers: Iterable[str], place: str = ""
) -> None:
    """Raise InputError for one of ``names`` to accept that is none of ``findings`` and cannot be one on ``rig``.

    ``numbers`` are the names of the numbers of device and model, which may be implausible, too. ``place`` begins the
    sentence.
    """
    others = (GRAVITY_NAME, *numbers)
    check_accepted_names(names, findings, (*SI_UNITS, *get_column_units(rig)), others, place)


def _describe_gait_trial(trial: Trial, units: Mapping[str, str]) -> GaitChannels:
    """Return the motion and the loads of ``trial``."""
    series = {**trial.prescribed, **trial.measured}
    channels = {
        name: ScaledSeries(name, Series(series[name].time, samples.value), samples.unit, samples.factor)
        for name, samples in collect_samples(trial, units, "gait").items()
        if name in GAIT_CHANNELS
    }
    return GaitChannels(f"trial '{trial.name}'", channels)


def find_implausible_changes(trials: Sequence[Trial], changes: Sequence[Mapping[str, float]]) -> list[Finding]:
    """Return what is implausible in the numbers of the device that the ``changes`` of each trial replace."""
    findings = []
    for trial, changed in zip(trials, changes, strict=True):
        devices = {
            "": trial.device,
            **{f"{tendon}{DEVICE_SEPARATOR}": tendon_device for tendon, tendon_device in trial.devices.items()},
        }
        for prefix, device in devices.items() if changed else ():
            number_findings = check_device_numbers(device.spec.collect_values(), f"trial '{trial.name}'")
            named = [finding._replace(name=f"{prefix}{finding.name}") for finding in number_findings]
            findings += [finding for finding in named if finding.name in changed]
    return findings


def collect_samples(trial: Trial, units: Mapping[str, str], rig: ChannelSource) -> dict[str, Samples]:
    """Return the channels of ``trial`` with the ``units`` in their headings."""
    si_units = get_column_units(rig)
    series = {**trial.prescribed, **trial.measured}
    return {
        name: Samples(name, series[name].value, units[name], unit_conversion.get_si_factor(units[name], si_unit) or 1.0)
        for name, si_unit in si_units.items()
        if name in series
    }


def _describe_trial(trial: Trial, content: TrialChannels, rig: ChannelSource) -> RecordedTrial:
    """Return the channels of ``trial`` that belong to its device, with the limits and a simulation of that device."""
    units = content.units
    samples = collect_samples(trial, units, rig)
    series = {**trial.prescribed, **trial.measured}
    time_unit = units[TIME_COLUMN]
    return RecordedTrial(
        name=trial.name,
        channels={name: Channel(series[name].time, samples[name]) for name in SI_UNITS if name in samples},
        limits=compute_device_limits(trial.device),
        simulate=build_simulation(trial.device),
        time_unit=(time_unit, unit_conversion.get_si_factor(time_unit, "s") or 1.0),
        group=trial.group,
        specimen=trial.specimen,
        scale_supply=build_scaled_supply(trial.device),
        sources=content.sources,
    )


def build_scaled_supply(device: Device) -> Callable[[float], Simulate] | None:
    """Return a function that builds the simulation of ``device`` with its supply faster by a factor.

    Returns None for a device without a supply.
    """
    if device.spec.supply is None:
        return None
    numbers = device.spec.collect_values()
    names = [name for name in SUPPLY_SPEEDS if name in numbers]

    def scale_supply(factor: float) -> Simulate:
        try:
            return build_simulation(device.with_changes({name: factor * numbers[name] for name in names}))
        except KluteSimError:  # the schema of device files does not allow this speed
            return lambda dt, length, command: None

    return scale_supply


def compute_device_limits(device: Device) -> DeviceLimits:
    """Return the limits of ``device``."""
    parameters = device.parameters
    muscle, pressure = parameters.muscle, parameters.supply.max_pressure
    unit_length = muscle.resting_length + parameters.tendon.slack_length
    state = compute_taut_state(parameters, unit_length, pressure).internal_state
    return DeviceLimits(
        muscle_length=muscle.resting_length,
        lock_length=lock_length(muscle),
        tendon_length=parameters.tendon.slack_length,
        supply_pressure=pressure,
        max_force=max(compute_muscle_force(parameters, state, pressure, muscle.resting_length, 0.0), 0.0),
    )


def build_simulation(device: Device) -> Simulate:
    """Return a function that simulates ``device``, and returns None where it has no finite state."""

    def simulate(dt: float, length: Array, command: Array) -> Response | None:
        parameters = device.parameters
        try:
            initial_state = compute_equilibrium_state(parameters, float(length[0]), float(command[0]))
            trace = simulate_rollouts(parameters, length, command, dt, initial_state=initial_state, n_jobs=1)
        except (KluteSimError, ArithmeticError, ValueError):  # the laws fail at lengths that no device has
            return None
        return Response(dt * np.arange(1.0, len(length) + 1.0), trace.tension, trace.pressure, trace.length)

    return simulate
