"""Measured trials with the weights of their residuals, and what simulations say of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from klute_sim.diagnosis.experiments.base import Experiment, SimulationSetup
from klute_sim.diagnosis.experiments.simulator import Simulator
from klute_sim.diagnosis.fitting.fit_cache import FitCache
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.noise.repeats import Noise, Residuals
from klute_sim.types import Array


@dataclass(frozen=True, eq=False)
class WeightedData:
    """Measured trials and the weights of their residuals."""

    simulator: Simulator
    """Simulator of the trials."""
    experiments: Sequence[Experiment]
    """Trials."""
    noise: Mapping[str, Noise]
    """Channel -> noise; other channels are not weighted and do not count."""
    cache: FitCache | None = None
    """Cache of finished fits."""
    has_law_error: bool = False
    """Whether the noise contains the error of an imperfect law, which all repeats of a condition share."""

    @property
    def n_effective(self) -> float:
        """Effective number of independent samples."""
        return sum(
            len(series.time) / self.noise[channel].correlation_time(series.sampling_interval)
            for e in self.experiments
            for channel, series in e.measured.items()
            if channel in self.noise
        )

    def compute_residuals(
        self, hypothesis: Hypothesis, points: Sequence[Array], *, coarse: bool = False, may_diverge: bool = False
    ) -> list[list[dict[str, Array]]]:
        """Return measured minus simulated [SI] per point of normalized parameters, experiment and channel.

        ``coarse`` simulations are faster and less accurate. A simulation that diverges raises SimulationError; with
        ``may_diverge`` its residuals are infinite.
        """
        setups = [hypothesis.build_setups(x, self.experiments) for x in points]
        return [
            [
                {channel: series.value - simulated[channel] for channel, series in e.measured.items()}
                for e, simulated in zip(self.experiments, readings, strict=True)
            ]
            for readings in self.simulator.simulate(setups, self.experiments, coarse=coarse, may_diverge=may_diverge)
        ]

    @cached_property
    def representatives(self) -> list[int]:
        """For each experiment: the index of its first repeat with the same samples.

        Repeats have the same inputs but for noise, so they share derivatives. Samples at the limit of a sensor respond
        in one repeat and not in another, so such trials represent themselves.
        """
        indices = []
        for index, e in enumerate(self.experiments):
            same = (k for k, other in enumerate(self.experiments[:index]) if _has_same_samples(e, other))
            indices.append(next(same, index))
        return indices

    def compute_changes(
        self, before: Sequence[SimulationSetup], after: Sequence[Sequence[SimulationSetup]], *, coarse: bool = False
    ) -> list[list[dict[str, Array]]]:
        """Return the changes of the residuals [SI] from the setups ``before`` to each row of setups ``after``.

        A row has one setup per experiment. Only :attr:`representatives` are simulated. Where a simulation diverges, the
        change is infinite.
        """
        indices = sorted(set(self.representatives))
        rows = [[row[index] for index in indices] for row in (before, *after)]
        simulated = [self.experiments[i] for i in indices]
        base, *changed = self.simulator.simulate(rows, simulated, coarse=coarse, may_diverge=True)
        positions = [indices.index(index) for index in self.representatives]
        return [
            [{channel: base[k][channel] - value for channel, value in readings[k].items()} for k in positions]
            for readings in changed
        ]

    def weight_residuals(self, residuals: Residuals) -> Array:
        """Return one vector of weighted residuals; its square is chi squared over independent samples."""
        parts = [
            weight * row[channel]
            for row, weights in zip(residuals, self.weights, strict=True)
            for channel, weight in weights.items()
        ]
        return np.concatenate(parts)

    def split_weighted_residuals(self, weighted_residuals: Array) -> list[dict[str, Array]]:
        """Return the residuals [SI] per experiment and channel of a vector of :meth:`weight_residuals`.

        Residuals of priors that follow in the vector are left out.
        """
        rows, start = [], 0
        for e, weights in zip(self.experiments, self.weights, strict=True):
            row = {}
            for channel, weight in weights.items():
                end = start + len(e.measured[channel].time)
                row[channel] = weighted_residuals[start:end] / weight
                start = end
            rows.append(row)
        return rows

    @cached_property
    def weights(self) -> list[dict[str, Array | float]]:
        """For each experiment: channel -> weight of its residuals [1/SI], a scalar or one per sample."""
        return [
            {
                channel: self.noise[channel].weight(series.sampling_interval)
                / (e.noise_scale.get(channel, 1.0) * e.input_error_scale.get(channel, 1.0))
                for channel, series in e.measured.items()
                if channel in self.noise
            }
            for e in self.experiments
        ]

    def compute_prior_residuals(self, hypothesis: Hypothesis, x: Array) -> Array:
        """Return the residuals of the priors of ``hypothesis`` at normalized parameters ``x``.

        A gain of the mechanical input multiplies its noise as well, so least squares would favour a small gain
        (regression dilution). The expected derivative of half of chi squared by the gain ``g`` at the truth is the
        number ``n`` of independent samples of this noise. The corrected score (Nakamura, Biometrika 77:127, 1990)
        subtracts it, which for a small gain is a prior whose mean is ``n dg/dx``.
        """
        return np.asarray(x[: hypothesis.n_prior_parameters] - self.n_noisy_inputs * hypothesis.input_gains)

    @cached_property
    def n_noisy_inputs(self) -> float:
        """Effective number of independent samples of the noise of the mechanical input."""
        return sum(
            float(np.sum(share / np.square(e.input_error_scale.get(channel, 1.0))))
            / self.noise[channel].correlation_time(e.measured[channel].sampling_interval)
            for e in self.experiments
            for channel, share in e.input_noise_share.items()
            if channel in self.noise and channel in e.measured
        )

    def with_experiments(self, experiments: Sequence[Experiment]) -> "WeightedData":
        """Return other ``experiments`` with the same noise."""
        return replace(self, experiments=experiments)


def _has_same_samples(experiment: Experiment, other: Experiment) -> bool:
    """Return whether two trials are repeats with the same duration and the same channels at the same times."""
    if experiment.group != other.group or experiment.limits or other.limits:
        return False
    if experiment.device.digest != other.device.digest or experiment.trusted != other.trusted:
        return False
    if experiment.dt != other.dt or len(experiment.command) != len(other.command):
        return False
    if experiment.measured.keys() != other.measured.keys():
        return False
    times = [(series.time, other.measured[channel].time) for channel, series in experiment.measured.items()]
    delay = experiment.start_time - other.start_time
    return all(len(a) == len(b) and np.allclose(a - delay, b, rtol=0.0, atol=1e-6) for a, b in times)
