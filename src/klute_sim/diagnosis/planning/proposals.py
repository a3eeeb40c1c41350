"""Proposal of the experiment that separates two models: a protocol, or a change of the rig.

Both models are simulated in every identification protocol, and the first is refitted, in linear approximation and with
the existing data, to the predictions of the second. The remaining difference, in units of the noise, is their
separation. No command separates some pairs: a second instrument distinguishes a sensor error from a device effect.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np

from klute_sim.bench.protocols.identification import IdentificationProtocol
from klute_sim.bench.protocols.library import load_identification_protocols
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import Device
from klute_sim.diagnosis.data_quality import find_moving_trials
from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.bench import BenchExperiment
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.least_squares import Fit, compute_difference_steps
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.planning.measurement_plan import check_has_plan
from klute_sim.diagnosis.selection.forward_selection import BIC_THRESHOLD
from klute_sim.errors import InputError, SimulationError
from klute_sim.mechanism.protocols import JointTrial, ProtocolSettings
from klute_sim.types import Array
from klute_sim.units import BAR

TIME_STEP = 2.5e-4
"""Time step of the simulation [s]."""
MUSCLE_LENGTH_NOISE = 2e-5
"""Noise of a muscle-length sensor that is not installed yet [m] (assumed)."""
ADDED_NOISE = {"muscle_length": MUSCLE_LENGTH_NOISE}
"""Noise of channels that a change of the rig adds [SI]."""
N_REPEATS = 2
"""Number of repeats of the proposed experiment; they count once where they share the error of an imperfect law."""
MIN_SEPARATION_RATIO = 2.0
"""Separation with a change of the rig over that without, above which the change is proposed (assumed)."""
NOT_SEPARABLE = (
    "No known protocol or change of the rig separates these models; treat them as one until another kind of "
    "measurement does."
)
"""Sentence where no proposal is decisive."""
SUFFICIENT_SEPARATION = 10.0 * BIC_THRESHOLD
"""Separation without a change of the rig, from which no change is proposed (assumed)."""


class RigChange(NamedTuple):
    """A change of the rig."""

    description: str
    """Description of the change, to follow a verb."""
    reference_channels: tuple[str, ...]
    """Channels that a second, ideal instrument also reads."""
    added_channels: tuple[str, ...] = ()
    """Channels that were not recorded before."""

    @property
    def is_none(self) -> bool:
        """Whether the rig stays as it is."""
        return not (self.reference_channels or self.added_channels)


RIG_CHANGES = (
    RigChange("with the rig as it is", ()),
    RigChange("with a sensor for the muscle's own length", (), ("muscle_length",)),
    RigChange("with a second gauge at the muscle's own port", ("pressure",)),
    RigChange("with the load cell checked by a dead weight before and after", ("force",)),
)
"""Changes of the rig that may be proposed for a device with a muscle; the first is none."""


def list_rig_changes(device: Device) -> list[RigChange]:
    """Return the changes of the rig that may be proposed for ``device``; the first is none."""
    spec = device.spec
    if spec.muscle is not None:
        return list(RIG_CHANGES)
    if spec.cylinder is not None:
        return [change._replace(description=change.description.replace("muscle", "cylinder")) for change in RIG_CHANGES]
    return [change for change in RIG_CHANGES if change.is_none or "force" in change.reference_channels]


def describe_inseparable_models(separation_chi2: float) -> dict[str, Any]:
    """Return the entry of ``verdict.json`` where the best experiment separates by ``separation_chi2`` only."""
    return {
        "protocol": None,
        "rig_change": None,
        "separation_chi2": round(separation_chi2, 1),
        "sentence": NOT_SEPARABLE,
    }


class ExperimentProposal(NamedTuple):
    """An experiment that separates two models."""

    protocol: IdentificationProtocol | JointTrial
    """Protocol of the bench, or trial of a joint, to record."""
    rig_change: RigChange
    """Change of the rig."""
    separation_chi2: float
    """Chi squared, in the independent samples of all repeats, by which the refitted models differ."""
    channels: tuple[str, ...]
    """Channels in which they differ: those of the data and of the change of the rig."""
    settings: ProtocolSettings | None = None
    """Pressures of the trial of a joint; a protocol of the bench has none."""
    needs_tester: bool = False
    """Whether it moves a device that no fitted trial moves."""

    def to_dict(self) -> dict[str, Any]:
        """Return the entry of ``verdict.json``."""
        if self.separation_chi2 <= BIC_THRESHOLD:
            return describe_inseparable_models(self.separation_chi2)
        name, command = f"'{self.protocol.name}'", f"klute-sim plan --only {self.protocol.name}; "
        pressures = self._list_pressures()
        if pressures:
            listing = ", ".join(f"{key.removesuffix('_bar')} {value:.2f} bar" for key, value in pressures.items())
            name, command = f"{name} ({listing}; klute-sim plan --model)", ""
        sentence = (
            f"Record protocol {name} twice ({command}channels: {', '.join(self.channels)}), "
            f"{self.rig_change.description}: the models then differ "
            f"by a chi squared of about {self.separation_chi2:.0f} ({BIC_THRESHOLD:.0f} are decisive)."
        )
        if self.needs_tester:
            sentence += " It changes the length, which no fitted trial does: this needs a tensile tester."
        return {
            "protocol": self.protocol.name,
            **self._list_pressures(),
            "channels": list(self.channels),
            "rig_change": None if self.rig_change.is_none else self.rig_change.description,
            "separation_chi2": round(self.separation_chi2, 1),
            "sentence": sentence,
        }

    def _list_pressures(self) -> dict[str, float]:
        """Return mean pressure and difference of the trial of a joint [bar] by key; empty for a protocol."""
        if self.settings is None:
            return {}
        mean, difference = self.settings.mean_pressure / BAR, self.settings.difference / BAR
        return {"mean_bar": round(mean, 4), "difference_bar": round(difference, 4)}


def propose_experiment(
    data: WeightedData, device: Device, best_fit: Fit, alternative: Fit
) -> ExperimentProposal | None:
    """Return the protocol and change of the rig that separate ``best_fit`` from ``alternative`` best.

    :func:`choose_proposal` says when a change of the rig is proposed. Returns None where ``device`` has no plan, or no
    protocol can be simulated.
    """
    try:
        check_has_plan(device)
    except InputError:
        return None
    proposals = [
        proposal
        for protocol in load_identification_protocols().values()
        for proposal in _evaluate_protocol(data, device, protocol, best_fit, alternative)
    ]
    return choose_proposal(proposals) if proposals else None


class SeparatingProposal(Protocol):
    """A proposal of any rig."""

    @property
    def rig_change(self) -> RigChange:
        """Change of the rig."""

    @property
    def separation_chi2(self) -> float:
        """Chi squared by which the refitted models differ."""


_Proposal = TypeVar("_Proposal", bound=SeparatingProposal)


def choose_proposal(proposals: Sequence[_Proposal]) -> _Proposal:
    """Return the best of ``proposals``, or the best one without a change of the rig, if that is nearly as good.

    A change is needed where nothing else is decisive. Otherwise it must separate much better, from an insufficient
    separation.
    """
    unchanged = max((p for p in proposals if p.rig_change.is_none), key=lambda p: p.separation_chi2)
    best = max(proposals, key=lambda p: p.separation_chi2)
    is_change_worthwhile = unchanged.separation_chi2 <= BIC_THRESHOLD or (
        best.separation_chi2 > MIN_SEPARATION_RATIO * unchanged.separation_chi2
        and unchanged.separation_chi2 < SUFFICIENT_SEPARATION
    )
    return best if is_change_worthwhile else unchanged


def _evaluate_protocol(
    data: WeightedData, device: Device, protocol: IdentificationProtocol, best_fit: Fit, alternative: Fit
) -> list[ExperimentProposal]:
    try:
        program = protocol.build_program(device)
    except InputError:
        return []
    grid = np.arange(TIME_STEP, program.time[-1], TIME_STEP)
    channels = dict.fromkeys([*data.noise, "muscle_length"])
    # The correlation time of the noise is known at the sampling interval of the data.
    sampling_interval = next(series for e in data.experiments for series in e.measured.values()).sampling_interval
    samples = np.arange(sampling_interval, program.time[-1], sampling_interval)
    experiment = BenchExperiment(
        name=protocol.name,
        group=protocol.name,
        use="fit",
        device=device,
        start_time=0.0,
        dt=TIME_STEP,
        unit_length=np.interp(grid, program.time, program.unit_length),
        command=np.interp(grid, program.time, program.command),
        measured={channel: TimeSeries(samples, samples) for channel in channels},
    )
    setups = build_separation_setups(best_fit, alternative, experiment)
    try:
        observed = simulate_channels(data.simulator, setups, experiment, with_sensor_errors=True)
        true_values = simulate_channels(data.simulator, setups, experiment, with_sensor_errors=False)
    except SimulationError:
        return []
    needs_tester = bool(find_moving_trials([experiment])) and not find_moving_trials(data.experiments)
    proposals = []
    for rig_change in list_rig_changes(device):
        if not set(rig_change.added_channels) & set(data.noise):
            predictions = weight_predictions(data, sampling_interval, rig_change, observed, true_values, ADDED_NOISE)
            separation = compute_separation(best_fit, predictions)
            recorded = (*data.noise, *rig_change.added_channels)
            proposals.append(ExperimentProposal(protocol, rig_change, separation, recorded, None, needs_tester))
    return proposals


def build_separation_setups(best_fit: Fit, alternative: Fit, experiment: Experiment) -> list[list[SimulationSetup]]:
    """Return the setups that :func:`compute_separation` needs: the best fit, its differences, and the alternative."""
    steps = np.diag(compute_difference_steps(best_fit.hypothesis, best_fit.x))
    setups = [best_fit.hypothesis.build_setups(x, [experiment]) for x in (best_fit.x, *(best_fit.x + steps))]
    return [*setups, alternative.hypothesis.build_setups(alternative.x, [experiment])]


def simulate_channels(
    simulator: Simulator,
    setups: Sequence[Sequence[SimulationSetup]],
    experiment: Experiment,
    *,
    with_sensor_errors: bool,
) -> list[dict[str, Array]]:
    """Return the channels of ``experiment`` for each of ``setups``."""
    if not with_sensor_errors:
        setups = [[setup._replace(sensors=()) for setup in row] for row in setups]
    return [row[0] for row in simulator.simulate(setups, [experiment])]


def weight_predictions(
    data: WeightedData,
    sampling_interval: float,
    rig_change: RigChange,
    observed: list[dict[str, Array]],
    true_values: list[dict[str, Array]],
    added_noise: Mapping[str, float],
) -> list[Array]:
    """Return one vector of weighted predictions per setup: existing channels, and those that the change adds.

    The weights are those of all repeats together. ``added_noise`` [SI] is that of the added channels.
    """
    scale = np.sqrt(1 if data.has_law_error else N_REPEATS)
    predictions = []
    for observed_row, true_row in zip(observed, true_values, strict=True):
        parts = []
        for channel, noise in data.noise.items():
            weight = noise.weight(sampling_interval)
            parts.append(weight * observed_row[channel])
            if channel in rig_change.reference_channels:
                parts.append(weight * true_row[channel])
        for channel in rig_change.added_channels:
            correlation_time = max(noise.correlation_time(sampling_interval) for noise in data.noise.values())
            parts.append(true_row[channel] / (added_noise[channel] * np.sqrt(correlation_time)))
        predictions.append(scale * np.concatenate(parts))
    return predictions


def compute_separation(best_fit: Fit, predictions: list[Array]) -> float:
    """Return chi squared between the last of ``predictions`` and the first, refitted with the others' derivatives.

    The predictions are those of :func:`build_separation_setups`.
    """
    current, *perturbed, alternative = predictions
    steps = compute_difference_steps(best_fit.hypothesis, best_fit.x)
    jacobian = (np.reshape(perturbed, (len(steps), len(current))) - current).T / steps
    matrix = np.concatenate([jacobian, best_fit.jacobian])
    target = np.concatenate([alternative - current, np.zeros(len(best_fit.jacobian))])
    solution = np.linalg.lstsq(matrix, target, rcond=None)[0]
    residual = target - matrix @ solution
    return float(residual @ residual)
