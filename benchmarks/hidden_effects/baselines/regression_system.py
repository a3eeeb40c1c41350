"""Linear regression of the missing force of the fit trials, beside the uncertain numbers of the device."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from benchmarks.hidden_effects.baselines.force_balance import ForceBalance, compute_balance
from benchmarks.hidden_effects.baselines.trials import Trials, Verdict, compute_gap, compute_rms

from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.errors import InputError
from klute_sim.types import Array


class BalanceTrials(NamedTuple):
    """Force balances of the trials with force and pressure, by use."""

    fit: list[ForceBalance]
    validation: list[ForceBalance]
    test: list[ForceBalance]
    is_length_measured: bool
    """Whether any of these trials has the muscle length."""

    def compute_test_gap(self, before: Sequence[Array], after: Sequence[Array]) -> Verdict:
        """Return the gap of the force as in ``verdict.json`` from the missing forces [N] of the test trials."""
        experiments = [balance.experiment for balance in self.test]
        return compute_gap(experiments, [{"force": f} for f in before], [{"force": f} for f in after])


def compute_balances(trials: Trials) -> BalanceTrials:
    """Return the force balances of ``trials``; raises InputError where no trial to fit has a tendon under load."""
    usable = [e for e in trials.experiments if {"force", "pressure"} <= e.measured.keys()]
    by_use = {
        use: [compute_balance(trials.dataset, e) for e in usable if e.use == use]
        for use in ("fit", "validation", "test")
    }
    if not sum(len(balance.missing_force) for balance in by_use["fit"]):
        raise InputError("no trial has a tendon under load")
    return BalanceTrials(**by_use, is_length_measured=any("muscle_length" in e.measured for e in usable))


class RegressionSystem:
    """Missing force of the fit trials after projection of the uncertain device numbers."""

    def __init__(self, trials: Sequence[ForceBalance]) -> None:
        """Set up the system in units of the noise of repeats, or of the missing force itself without repeats."""
        missing_force = np.concatenate([b.missing_force for b in trials])
        base_columns = np.concatenate([b.base_columns for b in trials])
        self.term_columns = np.concatenate([b.term_columns for b in trials])
        repeat_noise = estimate_noise_from_repeats(
            [b.experiment for b in trials], [{"force": b.missing_force} for b in trials]
        ).values()
        self._noise = sum(noise.std / np.sqrt(noise.independent_fraction) for noise in repeat_noise) or compute_rms(
            missing_force
        )
        self.missing_force = missing_force
        # The prior of each device number is one standard deviation: a row with target 0.
        self._prior_rows = np.vstack([base_columns / self._noise, np.eye(base_columns.shape[1])])

    def _pad_with_prior(self, columns: Array) -> Array:
        return np.vstack([columns / self._noise, np.zeros((self._prior_rows.shape[1], columns.shape[1]))])

    def project_out_numbers(self, columns: Array) -> Array:
        """Return ``columns`` [N] without the part that the device numbers can reproduce."""
        basis, _ = np.linalg.qr(self._prior_rows)
        padded = self._pad_with_prior(columns)
        return padded - basis @ (basis.T @ padded)

    def compute_residuals(self, trials: Sequence[ForceBalance], coefficients: Array | None = None) -> list[Array]:
        """Return the residual force [N] of ``trials`` with the device numbers refitted.

        ``coefficients`` are those of the terms in typical sizes; by default there are none.
        """
        if coefficients is None:
            coefficients = np.zeros(self.term_columns.shape[1])
        remaining = self._pad_with_prior((self.missing_force - self.term_columns @ coefficients)[:, None])[:, 0]
        base_coefficients = np.linalg.lstsq(self._prior_rows, remaining, rcond=None)[0]
        return [b.missing_force - b.base_columns @ base_coefficients - b.term_columns @ coefficients for b in trials]
