"""A Gaussian process as the discrepancy of the force, after Kennedy and O'Hagan (2001, J R Stat Soc B 63:425).

It names nothing. It learns the missing force of the fit trials as a function of contraction, velocity and pressure, and
says that something is missing where it predicts unseen trials better than the refitted device does.
"""

import warnings
from collections.abc import Sequence

import numpy as np
from benchmarks.hidden_effects.baselines.regression_system import RegressionSystem, compute_balances
from benchmarks.hidden_effects.baselines.trials import Trials, Verdict, compute_rms
from benchmarks.hidden_effects.score import MAX_ABSORBED_RESIDUAL

from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.errors import InputError

N_TRAINING_SAMPLES = 800
"""Number of samples of the fit trials, equally spaced, to which the process is fitted."""
LENGTH_SCALE_BOUNDS = (0.1, 30.0)
"""Bounds of the length scales, in standard deviations of each coordinate."""
MIN_EXPLAINED = MAX_ABSORBED_RESIDUAL
"""Predicted part of the missing force of the validation trials, RMS over the noise of repeats, from which something is
missing: what the benchmark counts as visible."""


def predict_discrepancy(trials: Trials, exclude: Sequence[str]) -> Verdict:
    """Return ``unexplained`` where the process predicts the validation trials, and else ``nothing-missing``.

    Without names there are none to ``exclude``. Raises InputError without a tendon under load or without repeats.
    """
    del exclude
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    balances = compute_balances(trials)
    system = RegressionSystem(balances.fit)
    target = np.concatenate(system.compute_residuals(balances.fit))
    points = np.concatenate([balance.operating_points for balance in balances.fit])
    center, spread, scale = points.mean(axis=0), points.std(axis=0), compute_rms(target)
    chosen = np.unique(np.linspace(0, len(target) - 1, N_TRAINING_SAMPLES).round().astype(int))
    kernel = ConstantKernel(1.0, (1e-4, 1e2)) * RBF(np.ones(3), LENGTH_SCALE_BOUNDS) + WhiteKernel(0.5, (1e-4, 1e1))
    process = GaussianProcessRegressor(kernel)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length scale at its bound is a valid answer
        process.fit(((points - center) / spread)[chosen], target[chosen] / scale)
    before, after = {}, {}
    for use, unseen in (("validation", balances.validation), ("test", balances.test)):
        before[use] = system.compute_residuals(unseen)
        after[use] = [
            force - scale * process.predict((balance.operating_points - center) / spread)
            for balance, force in zip(unseen, before[use], strict=True)
        ]
    experiments = [balance.experiment for balance in balances.validation]
    noise = estimate_noise_from_repeats(experiments, [{"force": force} for force in after["validation"]])
    if not noise:
        raise InputError("no validation trial was repeated, so the noise is unknown")
    left, remaining = (compute_rms(np.concatenate(forces["validation"])) for forces in (before, after))
    explained = float(np.sqrt(max(0.0, left**2 - remaining**2))) / noise["force"].std
    return {
        "verdict": "unexplained" if explained > MIN_EXPLAINED else "nothing-missing",
        "effects": [],
        "explained_over_noise": explained,
        "gap": balances.compute_test_gap(before["test"], after["test"]),
    }
