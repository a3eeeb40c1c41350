"""Proposal of the experiment on a joint or a free load that separates two models: a test, or another instrument.

As on the bench (:mod:`~klute_sim.diagnosis.planning.proposals`), with the tests of a joint around the pressures of the
data.
"""

from collections.abc import Collection, Iterable

import numpy as np

from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.mechanism import DatasetMechanism
from klute_sim.datasets.mechanism_channels import normalize_name, parse_channel
from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.initial_motion import MOTION_QUANTITIES
from klute_sim.diagnosis.experiments.mechanism import MechanismExperiment
from klute_sim.diagnosis.fitting.least_squares import Fit
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.planning.proposals import (
    ExperimentProposal,
    RigChange,
    build_separation_setups,
    choose_proposal,
    compute_separation,
    simulate_channels,
    weight_predictions,
)
from klute_sim.errors import InputError, SimulationError
from klute_sim.mechanism.assembly import Mechanism
from klute_sim.mechanism.protocols import JointTrial, ProtocolSettings, plan_test
from klute_sim.mechanism.run import find_joint, make_inputs
from klute_sim.types import Array

TIME_STEP = 5e-4
"""Time step of the simulation with a flow that is metered [s]; others are twice as long."""
PROPOSED_TRIALS = ("step_up_100pct", "step_down_100pct", "sine_1Hz", "sine_4Hz", "multisine")
"""Trials that may be proposed (assumed: the others of these tests add little to them)."""
ADDED_NOISE = {"force": 3.0, "pressure": 1e3}
"""Noise of a load cell [N] or a gauge [Pa] that is not installed yet (assumed)."""


def propose_joint_experiment(
    data: WeightedData, dataset: Dataset, best_fit: Fit, alternative: Fit
) -> ExperimentProposal | None:
    """Return the trial and change of the rig that separate ``best_fit`` from ``alternative`` best.

    Returns None for a mechanism that the tests are not made for: they need one joint, one device or two antagonists,
    and nothing prescribed but pressure commands. Returns None, too, where no trial can be simulated.
    """
    declared = dataset.mechanism
    if declared is None:
        return None
    commands = [parse_channel(name) for name in declared.channels.prescribed]
    if len(declared.devices) > 2 or any(channel.quantity != "pressure_command" for channel in commands):
        return None
    try:
        joint, unit = find_joint(declared.file)
    except InputError:
        return None
    settings = _read_settings(data)
    trials = [t for test in ("steps", "sines", "multisine") for t in plan_test(test, settings)]
    proposals = [
        proposal
        for trial in trials
        if trial.name in PROPOSED_TRIALS
        for proposal in _evaluate_trial(data, dataset, declared, trial, joint, unit, best_fit, alternative)
    ]
    return choose_proposal(proposals)._replace(settings=settings) if proposals else None


def _read_settings(data: WeightedData) -> ProtocolSettings:
    """Return mean pressure and largest difference of the commands of ``data``; both stay within their range."""
    rows = [
        np.stack(list(e.inputs.values()))[:, :: max(1, len(e.command) // 1000)]
        for e in data.experiments
        if isinstance(e, MechanismExperiment)
    ]
    commands = np.concatenate(rows, axis=1)
    lowest, highest = max(0.0, float(commands.min())), float(commands.max())
    spread = float(np.abs(commands[0] - commands[1]).max()) if len(commands) > 1 else highest - lowest
    difference = 0.5 * min(spread, highest - lowest)
    mean = min(max(float(commands.mean()), lowest + difference), highest - difference)
    return ProtocolSettings(mean, difference, 0.0)


def list_rig_changes(measured: Collection[str], tendons: Iterable[str]) -> list[RigChange]:
    """Return the changes of a rig with the ``measured`` channels that may be proposed; the first is none."""
    changes = [RigChange("with the rig as it is", ())]
    for name in measured:
        if parse_channel(name).quantity in MOTION_QUANTITIES:
            changes.append(RigChange("with a second sensor of the position", (name,)))
    for tendon in map(normalize_name, tendons):
        pressure, force = f"pressure_{tendon}", f"force_{tendon}"
        if pressure in measured:
            changes.append(RigChange(f"with a second gauge at the muscle of '{tendon}'", (pressure,)))
        else:
            changes.append(RigChange(f"with a gauge at the muscle of '{tendon}'", (), (pressure,)))
        if force not in measured:
            changes.append(RigChange(f"with a load cell in the cable of '{tendon}'", (), (force,)))
    return changes


def _evaluate_trial(
    data: WeightedData,
    dataset: Dataset,
    declared: DatasetMechanism,
    trial: JointTrial,
    joint: str,
    unit: str,
    best_fit: Fit,
    alternative: Fit,
) -> list[ExperimentProposal]:
    changes = list_rig_changes(data.noise, declared.devices)
    channels = list(dict.fromkeys([*data.noise, *(name for change in changes for name in change.added_channels)]))
    time: Array = TIME_STEP * np.arange(1, round(trial.duration / TIME_STEP) + 1, dtype=np.float64)
    inputs = make_inputs(trial, declared.devices, joint, unit, time, has_load=False)
    mechanism = Mechanism(declared.file, tuple(declared.devices), tuple(inputs))
    sampling_interval = next(series for e in data.experiments for series in e.measured.values()).sampling_interval
    samples = np.arange(sampling_interval, time[-1], sampling_interval)
    experiment = MechanismExperiment(
        name=trial.name,
        group=trial.name,
        use="fit",
        device=dataset.device,
        devices=declared.devices,
        start_time=0.0,
        dt=TIME_STEP,
        command=next(iter(inputs.values())),
        measured={name: TimeSeries(samples, samples) for name in channels},
        mechanism=mechanism,
        outputs={name: mechanism.bind(parse_channel(name)) for name in channels},
        inputs=inputs,
        numbers=declared.numbers,
        initial_positions={},
    )
    setups = build_separation_setups(best_fit, alternative, experiment)
    try:
        observed = simulate_channels(data.simulator, setups, experiment, with_sensor_errors=True)
        true_values = simulate_channels(data.simulator, setups, experiment, with_sensor_errors=False)
    except SimulationError:
        return []
    proposals = []
    for change in changes:
        added_noise = {name: ADDED_NOISE[parse_channel(name).quantity] for name in change.added_channels}
        predictions = weight_predictions(data, sampling_interval, change, observed, true_values, added_noise)
        recorded = (*data.noise, *change.added_channels)
        proposals.append(ExperimentProposal(trial, change, compute_separation(best_fit, predictions), recorded))
    return proposals
