"""The force balance of a measured trial: what muscle and damper lack in it, and what that may be made of.

The tendon is in series with muscle and damper, so these pull what the load cell shows. With pressure and muscle length
measured (or the length inferred from the force by the tendon's law, where nobody measured it), what is ``lacking`` is
the force shown less the force by the nominal device's law. :data:`TERMS` are functions of the same signals. Each
belongs to one effect by its physics, or to several that ask for the same force.

Blind by construction: what comes before the measured pressure (lag, dead time, regulator), readings that are late, and
the tendon where the muscle's length is measured.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from klute_sim.dataset.dataset import Dataset
from klute_sim.dataset.trial import Series
from klute_sim.device.step import NO_MEMORY, Parameters, muscle_side
from klute_sim.diagnose.experiment import Array, Experiment
from klute_sim.diagnose.hypothesis import Hypothesis
from klute_sim.laws import damper, mckibben, tendon
from klute_sim.units import BAR

SLACK = 30.0
"""Force [N] below which the tendon may be slack and tells no length."""
STOP = 3e-4
"""Distance from the muscle's resting length [m] below which the stop may carry part of the force."""
SLOW = 1e-3
"""Speed [m/s] over which the sign of a velocity turns round."""
RELAXATION = 1.0
"""Time constant [s] of a relaxing bladder: the typical one, because a linear regression cannot find it."""


@dataclass(frozen=True, eq=False)
class Signals:
    """What is known at the samples of the force, as ``parameters`` see it [SI]."""

    parameters: Parameters
    time: Array
    """Since the beginning of the trial."""
    unit_length: Array
    force: Array
    pressure: Array
    measured_length: Array | None
    """Of the muscle."""

    @cached_property
    def stretch(self) -> Array:
        """Of the tendon [m], by its law."""
        return np.array([tendon.stretch_under(self.parameters.tendon, max(0.0, f)) for f in self.force.tolist()])

    @cached_property
    def length(self) -> Array:
        """Of the muscle [m]."""
        if self.measured_length is not None:
            return self.measured_length
        return self.unit_length - self.parameters.tendon.slack_length - self.stretch

    @cached_property
    def rate(self) -> Array:
        """Of the muscle's length [m/s].

        By central differences: a wider window of Savitzky and Golay blurs the corners by more force than it saves in
        noise (on clean data at 200 Hz 8 N rms are left with 3 samples, 10 with 5, 15 with 7).
        """
        return np.gradient(self.length, self.time)

    def law(self, pressure: float = 0.0, length: float = 0.0) -> Array:
        """Force [N] of muscle and damper, with so much added to pressure [Pa] and length [m]."""
        rows = zip(
            (self.pressure + pressure).tolist(), (self.length + length).tolist(), self.rate.tolist(), strict=True
        )
        return np.array([muscle_side(self.parameters, NO_MEMORY, *row) for row in rows])

    @cached_property
    def usable(self) -> np.ndarray:
        """Where neither a slack tendon nor a stop is in the balance."""
        return (self.force > SLACK) & (self.length < self.parameters.muscle.resting_length - STOP)

    @cached_property
    def bars(self) -> Array:
        """Pressure of all muscles together [bar]."""
        return self.parameters.muscle.actuators * self.pressure / BAR

    @cached_property
    def contraction(self) -> Array:
        """``1 - L/L0``."""
        return 1.0 - self.length / self.parameters.muscle.resting_length

    @cached_property
    def per_bar(self) -> Array:
        """Slope of the law with pressure [N/bar]."""
        return (self.law(pressure=1e3) - self.law(pressure=-1e3)) / 2e3 * BAR

    @cached_property
    def per_mm(self) -> Array:
        """Slope of the law with muscle length [N/mm]."""
        return (self.law(length=1e-5) - self.law(length=-1e-5)) / 2e-2

    @cached_property
    def gas(self) -> Array:
        """Gas tension [N]."""
        rows = zip(self.pressure.tolist(), self.length.tolist(), strict=True)
        return np.array([mckibben.gas_force(self.parameters.muscle, *row) for row in rows])

    @cached_property
    def damping(self) -> Array:
        """Damper tension [N]."""
        return np.array([damper.force(self.parameters.damper, v) for v in self.rate.tolist()])

    @cached_property
    def given(self) -> Array:
        """Millimetres that the tendon would give if it pulled as much again, by its slope."""
        more = np.array([tendon.stretch_under(self.parameters.tendon, max(0.0, f) + 1.0) for f in self.force.tolist()])
        return 1e3 * (more - self.stretch) * self.force

    @cached_property
    def unrelaxed(self) -> Array:
        """Muscle length less the length that the bladder has relaxed to [mm]."""
        keep = float(np.exp(-np.median(np.diff(self.time)) / RELAXATION))
        first = self.length[0]
        relaxed, _ = lfilter([1.0 - keep], [1.0, -keep], self.length, zi=[keep * first])
        return 1e3 * (self.length - relaxed)

    def coned(self) -> Array:
        """Gas tension lost per millimetre of conical tip [N/mm]: ``n P 2 (4/3) L / (4 pi N^2)``."""
        turns = self.parameters.muscle.turns
        return self.bars * BAR * 2.0 * (4.0 / 3.0 * 1e-3) * self.length / (4.0 * np.pi * turns * turns)


def sign(rate: Array) -> Array:
    """Direction of motion, smooth around rest."""
    return rate / np.hypot(rate, SLOW)


class Meaning(NamedTuple):
    """An effect that asks for a term's force."""

    name: str
    form: str
    channel: str | None = None


class Term(NamedTuple):
    """A function of the signals, with a coefficient to be found."""

    formula: str
    size: float
    """Of the coefficient, typically, in the unit of the effect's parameter."""
    force: Callable[[Signals], Array]
    """[N] per unit of the coefficient."""
    meanings: tuple[Meaning, ...]

    def possible(self, measured: bool, exclude: Sequence[str], positive: bool) -> list[Meaning]:
        """Effects that may be meant.

        A fault of an instrument may have either sign, an effect on the device only a ``positive`` coefficient. The
        tendon is in the balance only where the muscle's length is not ``measured``; otherwise that instrument is.
        """
        return [
            m
            for m in self.meanings
            if m.name not in exclude
            and (positive or m.channel is not None)
            and (measured or m.channel != "muscle_length")
            and not (measured and m.name.startswith("tendon_"))
        ]


TERMS = (
    Term("n p sign(v)", 8.0, lambda s: s.bars * sign(s.rate), (Meaning("braid_hysteresis", "coulomb"),)),
    # Below its transition speed an orifice is linear, so a small one of the two cannot be told from the other.
    Term(
        "n v",
        150.0,
        lambda s: s.parameters.muscle.actuators * s.rate,
        (Meaning("muscle_damping", "viscous"), Meaning("laminar_orifice", "smooth")),
    ),
    Term("n p v", 40.0, lambda s: s.bars * s.rate, (Meaning("muscle_damping", "pressure"),)),
    Term("sign(v)", 15.0, lambda s: sign(s.rate), (Meaning("seal_friction", "coulomb"),)),
    Term("c |v| v", 1.0, lambda s: s.damping, (Meaning("discharge_loss", "constant"),)),
    Term(
        "-dF/dp",
        0.5,
        lambda s: -s.per_bar,
        (Meaning("threshold_pressure", "constant"), Meaning("sensor_offset", "linear", "pressure")),
    ),
    Term(
        "-(1 - L/L0) dF/dp",
        10.0,
        lambda s: -s.contraction * s.per_bar,
        (Meaning("threshold_pressure", "rising"),),
    ),
    Term("-n p L", 8.0, lambda s: -s.coned(), (Meaning("end_taper", "cone"),)),
    Term("-(1 - L/L0) F_gas", 1.0, lambda s: -s.contraction * s.gas, (Meaning("end_taper", "strain"),)),
    Term(
        "n (L - relaxed L)",
        3.0,
        lambda s: s.parameters.muscle.actuators * s.unrelaxed,
        (Meaning("bladder_relaxation", "maxwell"),),
    ),
    Term(
        "F/k sign(dx/dt) dF/dL",
        0.06,
        lambda s: s.given * sign(np.gradient(s.stretch, s.time)) * s.per_mm,
        (Meaning("tendon_hysteresis", "slip"),),
    ),
    Term(
        "-dF/dL",
        1.5,
        lambda s: -s.per_mm,
        (Meaning("tendon_slack", "dead_length"), Meaning("sensor_offset", "linear", "muscle_length")),
    ),
    Term("-L dF/dL", 0.005, lambda s: -1e3 * s.length * s.per_mm, (Meaning("sensor_gain", "linear", "muscle_length"),)),
    Term("-t dF/dL", 0.1, lambda s: -s.time * s.per_mm, (Meaning("sensor_drift", "linear", "muscle_length"),)),
    # By the law, because the force shown is in what is to be explained.
    Term("F_law", 0.05, lambda s: s.law(), (Meaning("sensor_gain", "linear", "force"),)),
    Term("1", 15.0, lambda s: np.ones_like(s.force), (Meaning("sensor_offset", "linear", "force"),)),
    Term("t", 4.0, lambda s: s.time, (Meaning("sensor_drift", "linear", "force"),)),
    Term("-p dF/dp", 0.05, lambda s: -s.pressure / BAR * s.per_bar, (Meaning("sensor_gain", "linear", "pressure"),)),
    Term("-t dF/dp", 0.02, lambda s: -s.time * s.per_bar, (Meaning("sensor_drift", "linear", "pressure"),)),
)
"""Sizes are those of the catalogue; of an instrument's fault, what its sheet might allow."""


class Balance(NamedTuple):
    """The balance of one trial, where it can be made up."""

    experiment: Experiment
    """Its one channel is ``lacking``, called force."""
    lacking: Array
    """[N]"""
    base: Array
    """(samples, uncertain numbers of the device) [N] per standard deviation."""
    terms: Array
    """(samples, :data:`TERMS`) [N] per typical size."""


def balance(dataset: Dataset, experiment: Experiment) -> Balance:
    """Make up the balance of a trial that has force and pressure."""
    hypothesis = Hypothesis(dataset.device, tuple(dataset.uncertain.items()), ())
    rows = [hypothesis.start(), *np.eye(hypothesis.base)]
    devices = [hypothesis.settings(row, [experiment])[0].parameters for row in rows]
    nominal, *moved = (_signals(device, experiment) for device in devices)
    lacking = nominal.force - nominal.law()
    base = [lacking - (each.force - each.law()) for each in moved]
    terms = [term.size * term.force(nominal) for term in TERMS]
    use = nominal.usable
    time = experiment.begin + nominal.time[use]
    alone = replace(experiment, measured={"force": Series(time, lacking[use])})
    return Balance(alone, lacking[use], np.array(base).T[use], np.array(terms).T[use])


def _signals(parameters: Parameters, experiment: Experiment) -> Signals:
    force = experiment.measured["force"]
    clock = experiment.begin + experiment.step * np.arange(1, len(experiment.command) + 1)
    pressure, length = experiment.measured["pressure"], experiment.measured.get("muscle_length")
    return Signals(
        parameters,
        force.time - experiment.begin,
        np.interp(force.time, clock, experiment.unit_length),
        force.value,
        np.interp(force.time, pressure.time, pressure.value),
        None if length is None else np.interp(force.time, length.time, length.value),
    )
