"""The experiment that would tell two rivals apart: a command, or a change of the rig.

Both rivals are simulated in every protocol; the first may then be refitted to what the second predicts, held by the
data there are already. What is left in units of the noise is how well the experiment would separate them. Some pairs
no command can separate: an instrument's fault is told from physics by a second instrument.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from klute_sim.bench.protocols.identification import PROTOCOLS, IdentificationProtocol
from klute_sim.datasets.trial import Series
from klute_sim.device.device import Device
from klute_sim.diagnosis.experiments.base import Array, Experiment, SimulationSetup, Simulator
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.fitting.least_squares import FINITE_DIFFERENCE_STEP, Fit, WeightedData
from klute_sim.diagnosis.selection.forward_selection import BIC_THRESHOLD
from klute_sim.errors import InputError

TIME_STEP = 2.5e-4
"""Of the simulation [s]."""
MUSCLE_LENGTH_NOISE = 2e-5
"""Noise of a muscle-length sensor where there is none yet [m] (assumed)."""


class RigChange(NamedTuple):
    """A change of the rig."""

    description: str
    reference_channels: tuple[str, ...]
    """Channels that are read by a second, faultless instrument."""
    added_channels: tuple[str, ...] = ()
    """Channels that were not recorded before."""


RIG_CHANGES = (
    RigChange("with the rig as it is", ()),
    RigChange("with a sensor for the muscle's own length", (), ("muscle_length",)),
    RigChange("with a second gauge at the muscle's own port", ("pressure",)),
    RigChange("with the load cell checked by a dead weight before and after", ("force",)),
)


class ExperimentProposal(NamedTuple):
    """An experiment and what it would tell."""

    protocol: IdentificationProtocol
    rig_change: RigChange
    separation_chi2: float
    """Chi squared, in independent samples, that the rivals differ by when refitted; two repeats."""

    def to_dict(self) -> dict[str, Any]:
        """For ``verdict.json``."""
        if self.separation_chi2 <= BIC_THRESHOLD:
            sentence = (
                "No protocol or change of the rig that is known separates these; treat them as one until another "
                "kind of measurement does."
            )
        else:
            sentence = (
                f"Record protocol '{self.protocol.name}' twice, {self.rig_change.description}: the rivals then differ by a chi "
                f"squared of about {self.separation_chi2:.0f} ({BIC_THRESHOLD:.0f} decide)."
            )
        return {
            "protocol": self.protocol.name,
            "rig_change": self.rig_change.description
            if self.rig_change.reference_channels or self.rig_change.added_channels
            else None,
            "separation_chi2": round(self.separation_chi2, 1),
            "sentence": sentence,
        }


def propose_experiment(data: WeightedData, device: Device, best_fit: Fit, alternative: Fit) -> ExperimentProposal:
    """The protocol and change of the rig that separate ``found`` from ``rival`` best.

    A change of the rig is only proposed where it separates at least twice as well as the best command without one.
    """
    every = [p for name in PROTOCOLS for p in _evaluate_protocol(data, device, PROTOCOLS[name], best_fit, alternative)]
    if not every:
        raise InputError(f"no protocol can be run on device '{device.name}'")
    plain = max(
        (p for p in every if not (p.rig_change.reference_channels or p.rig_change.added_channels)),
        key=lambda p: p.separation_chi2,
    )
    best = max(every, key=lambda p: p.separation_chi2)
    return (
        best
        if best.separation_chi2 > 2.0 * plain.separation_chi2 and plain.separation_chi2 < 10.0 * BIC_THRESHOLD
        else plain
    )


def _evaluate_protocol(
    data: WeightedData, device: Device, protocol: IdentificationProtocol, best_fit: Fit, alternative: Fit
) -> list[ExperimentProposal]:
    try:
        program = protocol.build_program(device)
    except InputError:
        return []
    grid = np.arange(TIME_STEP, program.time[-1], TIME_STEP)
    channels = dict.fromkeys([*data.noise, "muscle_length"])
    # As often as the data have it: for how long noise stays alike is known of that.
    interval = next(series for e in data.experiments for series in e.measured.values()).sampling_interval
    samples = np.arange(interval, program.time[-1], interval)
    experiment = BenchExperiment(
        name=protocol.name,
        group=protocol.name,
        use="fit",
        device=device,
        start_time=0.0,
        dt=TIME_STEP,
        unit_length=np.interp(grid, program.time, program.unit_length),
        command=np.interp(grid, program.time, program.command),
        measured={channel: Series(samples, samples) for channel in channels},
    )
    rows = [best_fit.x, *(best_fit.x + FINITE_DIFFERENCE_STEP * unit for unit in np.eye(len(best_fit.x)))]
    settings = [*(best_fit.hypothesis.build_setups(row, [experiment]) for row in rows)]
    settings.append(alternative.hypothesis.build_setups(alternative.x, [experiment]))
    shown = _simulate_channels(data.simulator, settings, experiment, with_sensor_errors=True)
    true = _simulate_channels(data.simulator, settings, experiment, with_sensor_errors=False)
    return [
        ExperimentProposal(
            protocol, change, _compute_separation(best_fit, _weight_predictions(data, interval, change, shown, true))
        )
        for change in RIG_CHANGES
        if not set(change.added_channels) & set(data.noise)
    ]


def _simulate_channels(
    simulator: Simulator,
    settings: Sequence[Sequence[SimulationSetup]],
    experiment: Experiment,
    *,
    with_sensor_errors: bool,
) -> list[dict[str, Array]]:
    if not with_sensor_errors:
        settings = [[one._replace(sensors=()) for one in row] for row in settings]
    return [row[0] for row in simulator.simulate(settings, [experiment])]


def _weight_predictions(
    data: WeightedData,
    interval: float,
    rig_change: RigChange,
    observed: list[dict[str, Array]],
    true_values: list[dict[str, Array]],
) -> list[Array]:
    """Weighted predictions, one vector per setting: of the channels there are, and of what the change adds."""
    found = []
    for seen, there in zip(observed, true_values, strict=True):
        parts = []
        for channel, noise in data.noise.items():
            weight = noise.weight(interval)
            parts.append(weight * seen[channel])
            if channel in rig_change.reference_channels:
                parts.append(weight * there[channel])
        for channel in rig_change.added_channels:
            slowest = max(noise.correlation_time(interval) for noise in data.noise.values())
            parts.append(there[channel] / (MUSCLE_LENGTH_NOISE * np.sqrt(slowest)))
        found.append(np.concatenate(parts))
    return found


def _compute_separation(best_fit: Fit, predictions: list[Array]) -> float:
    here, *moved, other = predictions
    slope = (
        np.stack([(each - here) / FINITE_DIFFERENCE_STEP for each in moved], axis=1)
        if moved
        else np.empty((len(here), 0))
    )
    repeats = np.sqrt(2.0)
    matrix = np.concatenate([repeats * slope, best_fit.jacobian])
    target = np.concatenate([repeats * (other - here), np.zeros(len(best_fit.jacobian))])
    answer = np.linalg.lstsq(matrix, target, rcond=None)[0]
    left = target - matrix @ answer
    return float(left @ left)
