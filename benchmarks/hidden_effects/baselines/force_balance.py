"""Force balance of a measured trial: the force that muscle and damper of the nominal device lack, and candidate terms.

The tendon is in series with muscle and damper, so their force is that of the load cell. With measured pressure and
muscle length (or the length inferred from the force by the tendon law), the ``missing_force`` is the measured force
less that of the nominal device. :data:`BALANCE_TERMS` are functions of the same signals. Each belongs to one effect, or
to several that require the same force.

The balance cannot detect effects before the measured pressure (lag, dead time, regulator), delayed readings, and the
tendon where the muscle length is measured.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from klute_sim.datasets.dataset import Dataset
from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, DeviceParameters, compute_muscle_force
from klute_sim.diagnosis.experiments.base import Experiment
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.laws import damper, mckibben, tendon
from klute_sim.types import Array
from klute_sim.units import BAR

MIN_TAUT_FORCE = 30.0
"""Force [N] below which the tendon may be slack and does not determine a length."""
STOP_CLEARANCE = 3e-4
"""Distance from the resting length [m] below which the stop may carry part of the force."""
SIGN_SPEED = 1e-3
"""Speed [m/s] over which the sign of a velocity changes smoothly."""
RELAXATION_TIME = 1.0
"""Time constant [s] of a relaxing bladder: the typical value, because a linear regression cannot determine it."""


@dataclass(frozen=True, eq=False)
class BalanceSignals:
    """Signals at the samples of the force in SI units, for the device with ``parameters``."""

    parameters: DeviceParameters
    time: Array
    """Time since the start of the trial [s]."""
    unit_length: Array
    force: Array
    pressure: Array
    measured_length: Array | None
    """Measured muscle length [m]; None if it was not measured."""

    @cached_property
    def stretch(self) -> Array:
        """Return the tendon stretch [m] by its law."""
        return np.array([tendon.stretch_at_tension(self.parameters.tendon, max(0.0, f)) for f in self.force.tolist()])

    @cached_property
    def length(self) -> Array:
        """Return the muscle length [m]."""
        if self.measured_length is not None:
            return self.measured_length
        return self.unit_length - self.parameters.tendon.slack_length - self.stretch

    @cached_property
    def velocity(self) -> Array:
        """Return the rate of the muscle length [m/s] by central differences.

        A wider Savitzky-Golay window smooths the corners by more force than it saves in noise: on clean data at 200 Hz,
        8 N RMS remain with 3 samples, 10 with 5 and 15 with 7.
        """
        return np.gradient(self.length, self.time)

    def model_force(self, pressure_offset: float = 0.0, length_offset: float = 0.0) -> Array:
        """Return the force [N] of muscle and damper with offsets of pressure [Pa] and length [m]."""
        rows = zip(
            (self.pressure + pressure_offset).tolist(),
            (self.length + length_offset).tolist(),
            self.velocity.tolist(),
            strict=True,
        )
        return np.array([compute_muscle_force(self.parameters, ZERO_INTERNAL_STATE, *row) for row in rows])

    @cached_property
    def is_usable(self) -> np.ndarray:
        """Return where neither a slack tendon nor a stop affects the balance."""
        return (self.force > MIN_TAUT_FORCE) & (self.length < self.parameters.muscle.resting_length - STOP_CLEARANCE)

    @cached_property
    def total_pressure_bar(self) -> Array:
        """Return the pressure times the number of muscles [bar]."""
        return self.parameters.muscle.n_actuators * self.pressure / BAR

    @cached_property
    def contraction(self) -> Array:
        """Return ``1 - L/L0``."""
        return 1.0 - self.length / self.parameters.muscle.resting_length

    @cached_property
    def force_per_bar(self) -> Array:
        """Return the derivative of the force with pressure [N/bar]."""
        return (self.model_force(pressure_offset=1e3) - self.model_force(pressure_offset=-1e3)) / 2e3 * BAR

    @cached_property
    def force_per_mm(self) -> Array:
        """Return the derivative of the force with muscle length [N/mm]."""
        return (self.model_force(length_offset=1e-5) - self.model_force(length_offset=-1e-5)) / 2e-2

    @cached_property
    def gas_force(self) -> Array:
        """Return the gas tension [N]."""
        rows = zip(self.pressure.tolist(), self.length.tolist(), strict=True)
        return np.array([mckibben.gas_force(self.parameters.muscle, *row) for row in rows])

    @cached_property
    def damper_force(self) -> Array:
        """Return the damper tension [N]."""
        return np.array([damper.force(self.parameters.damper, v) for v in self.velocity.tolist()])

    @cached_property
    def compliant_stretch_mm(self) -> Array:
        """Return the tendon stretch under its current force at its current slope [mm]."""
        increased_stretch = np.array(
            [tendon.stretch_at_tension(self.parameters.tendon, max(0.0, f) + 1.0) for f in self.force.tolist()]
        )
        return 1e3 * (increased_stretch - self.stretch) * self.force

    @cached_property
    def unrelaxed_length_mm(self) -> Array:
        """Return the muscle length less the relaxed length of the bladder [mm]."""
        decay = float(np.exp(-np.median(np.diff(self.time)) / RELAXATION_TIME))
        initial_length = self.length[0]
        relaxed, _ = lfilter([1.0 - decay], [1.0, -decay], self.length, zi=[decay * initial_length])
        return 1e3 * (self.length - relaxed)

    def cone_force(self) -> Array:
        """Return the gas tension lost to cones of 45 degrees [N]: ``n P dV/dL`` of the volume outside them."""
        muscle = self.parameters.muscle

        def radius(length: Array | float) -> Array:
            return np.sqrt(muscle.braid_length**2 - np.square(length)) / (2.0 * np.pi * muscle.braid_turns)

        def volume(length: Array) -> Array:
            wide, narrow = radius(length), radius(muscle.resting_length)
            height = wide - narrow
            return 2.0 * np.pi * height * (wide**2 - (wide**2 + wide * narrow + narrow**2) / 3.0)

        step = 1e-6
        slope = (volume(self.length + step) - volume(self.length - step)) / (2.0 * step)
        return -self.total_pressure_bar * BAR * slope


def smooth_sign(velocity: Array) -> Array:
    """Return the direction of motion, smooth around rest."""
    return velocity / np.hypot(velocity, SIGN_SPEED)


class CandidateEffect(NamedTuple):
    """An effect that requires the force of a term."""

    name: str
    form: str
    channel: str | None = None


class BalanceTerm(NamedTuple):
    """A function of the signals with an unknown coefficient."""

    formula: str
    typical_size: float
    """Typical coefficient in the unit of the parameter of the effect."""
    evaluate_force: Callable[[BalanceSignals], Array]
    """Force [N] per unit of the coefficient."""
    candidates: tuple[CandidateEffect, ...]

    def possible_effects(
        self, length_measured: bool, exclude: Sequence[str], is_positive: bool
    ) -> list[CandidateEffect]:
        """Return the effects that the term may represent.

        An instrument fault may have either sign, an effect of the device only a positive coefficient. The tendon is in
        the balance only where the muscle length is not measured; otherwise its instrument is.
        """
        return [
            m
            for m in self.candidates
            if m.name not in exclude
            and (is_positive or m.channel is not None)
            and (length_measured or m.channel != "muscle_length")
            and not (length_measured and m.name.startswith("tendon_"))
        ]


BALANCE_TERMS = (
    BalanceTerm(
        "n p sign(v)",
        8.0,
        lambda s: s.total_pressure_bar * smooth_sign(s.velocity),
        (CandidateEffect("braid_hysteresis", "coulomb"),),
    ),
    # Below its transition speed an orifice is linear, so the two effects are indistinguishable.
    BalanceTerm(
        "n v",
        150.0,
        lambda s: s.parameters.muscle.n_actuators * s.velocity,
        (CandidateEffect("muscle_damping", "viscous"), CandidateEffect("laminar_orifice", "smooth")),
    ),
    BalanceTerm(
        "n p v", 40.0, lambda s: s.total_pressure_bar * s.velocity, (CandidateEffect("muscle_damping", "pressure"),)
    ),
    BalanceTerm("sign(v)", 15.0, lambda s: smooth_sign(s.velocity), (CandidateEffect("seal_friction", "coulomb"),)),
    BalanceTerm("c |v| v", 1.0, lambda s: s.damper_force, (CandidateEffect("discharge_loss", "constant"),)),
    BalanceTerm(
        "-dF/dp",
        0.5,
        lambda s: -s.force_per_bar,
        (CandidateEffect("threshold_pressure", "constant"), CandidateEffect("sensor_offset", "linear", "pressure")),
    ),
    BalanceTerm(
        "-(1 - L/L0) dF/dp",
        10.0,
        lambda s: -s.contraction * s.force_per_bar,
        (CandidateEffect("threshold_pressure", "rising"),),
    ),
    BalanceTerm("-n p L (R - R0)", 1.0, lambda s: -s.cone_force(), (CandidateEffect("end_taper", "cone"),)),
    BalanceTerm(
        "-(1 - L/L0) F_gas", 1.0, lambda s: -s.contraction * s.gas_force, (CandidateEffect("end_taper", "strain"),)
    ),
    BalanceTerm(
        "n (L - relaxed L)",
        3.0,
        lambda s: s.parameters.muscle.n_actuators * s.unrelaxed_length_mm,
        (CandidateEffect("bladder_relaxation", "maxwell"),),
    ),
    BalanceTerm(
        "F/2k sign(dx/dt) dF/dL",
        0.05,
        lambda s: 0.5 * s.compliant_stretch_mm * smooth_sign(np.gradient(s.stretch, s.time)) * s.force_per_mm,
        (CandidateEffect("tendon_hysteresis", "slip"),),
    ),
    BalanceTerm(
        "-dF/dL",
        1.5,
        lambda s: -s.force_per_mm,
        (CandidateEffect("tendon_slack", "dead_length"), CandidateEffect("sensor_offset", "linear", "muscle_length")),
    ),
    BalanceTerm(
        "-L dF/dL",
        0.005,
        lambda s: -1e3 * s.length * s.force_per_mm,
        (CandidateEffect("sensor_gain", "linear", "muscle_length"),),
    ),
    BalanceTerm(
        "-t dF/dL",
        0.1,
        lambda s: -s.time * s.force_per_mm,
        (CandidateEffect("sensor_drift", "linear", "muscle_length"),),
    ),
    # By the law, because the measured force is part of the missing force.
    BalanceTerm("F_law", 0.05, lambda s: s.model_force(), (CandidateEffect("sensor_gain", "linear", "force"),)),
    BalanceTerm("1", 15.0, lambda s: np.ones_like(s.force), (CandidateEffect("sensor_offset", "linear", "force"),)),
    BalanceTerm("t", 4.0, lambda s: s.time, (CandidateEffect("sensor_drift", "linear", "force"),)),
    BalanceTerm(
        "-p dF/dp",
        0.05,
        lambda s: -s.pressure / BAR * s.force_per_bar,
        (CandidateEffect("sensor_gain", "linear", "pressure"),),
    ),
    BalanceTerm(
        "-t dF/dp", 0.02, lambda s: -s.time * s.force_per_bar, (CandidateEffect("sensor_drift", "linear", "pressure"),)
    ),
)
"""Terms with the typical sizes of the catalogue, and for instrument faults the tolerance of a data sheet."""


class ForceBalance(NamedTuple):
    """Balance of one trial where it can be evaluated."""

    experiment: Experiment
    """Experiment whose only channel, named force, is the missing force."""
    missing_force: Array
    """Missing force [N]."""
    base_columns: Array
    """Derivatives [N] per standard deviation, shape (samples, uncertain numbers)."""
    term_columns: Array
    """Forces [N] per typical size, shape (samples, :data:`BALANCE_TERMS`)."""
    operating_points: Array
    """Contraction, velocity [m/s] and pressure [bar], shape (samples, 3)."""


def compute_balance(dataset: Dataset, experiment: Experiment) -> ForceBalance:
    """Return the balance of a trial with force and pressure."""
    hypothesis = Hypothesis(dataset.device, tuple(dataset.uncertainties.items()), ())
    rows = [hypothesis.initial_point(), *np.eye(hypothesis.n_prior_parameters)]
    devices = [hypothesis.build_setups(row, [experiment])[0].parameters for row in rows]
    nominal, *perturbed = (_extract_signals(device, experiment) for device in devices)
    missing_force = nominal.force - nominal.model_force()
    base_columns = [missing_force - (signals.force - signals.model_force()) for signals in perturbed]
    term_columns = [term.typical_size * term.evaluate_force(nominal) for term in BALANCE_TERMS]
    usable = nominal.is_usable
    time = experiment.start_time + nominal.time[usable]
    reduced_experiment = replace(experiment, measured={"force": TimeSeries(time, missing_force[usable])})
    operating_points = np.column_stack([nominal.contraction, nominal.velocity, nominal.pressure / BAR])
    return ForceBalance(
        reduced_experiment,
        missing_force[usable],
        np.array(base_columns).T[usable],
        np.array(term_columns).T[usable],
        operating_points[usable],
    )


def _extract_signals(parameters: DeviceParameters, experiment: Experiment) -> BalanceSignals:
    force = experiment.measured["force"]
    clock = experiment.start_time + experiment.dt * np.arange(1, len(experiment.command) + 1)
    pressure, length = experiment.measured["pressure"], experiment.measured.get("muscle_length")
    return BalanceSignals(
        parameters,
        force.time - experiment.start_time,
        np.interp(force.time, clock, experiment.unit_length),
        force.value,
        np.interp(force.time, pressure.time, pressure.value),
        None if length is None else np.interp(force.time, length.time, length.value),
    )
