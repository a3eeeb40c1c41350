"""Trials of gait: the pylon moves as measured, the measured reaction pushes on the foot, and the ankle is free."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from klute_sim.datasets.trial import Series, Trial, Use
from klute_sim.device.device import Device
from klute_sim.device.schema import effects
from klute_sim.diagnosis.experiments.base import (
    COARSE_STEP_FACTOR,
    PRESSURE_PERTURBATION,
    Array,
    DeviceResponse,
    Experiment,
    PrescribedInput,
    SimulationSetup,
    select_samples,
)
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.gait.replay.prescribed import CUTOFF_FREQUENCY_HZ, PrescribedMotion, prepare_prescribed_motion
from klute_sim.gait.replay.rollout import ReplayInputs, simulate_replay
from klute_sim.laws.foot import Foot, moment_arm

TIME_STEP = 5e-4
"""Time step [s]; together with one twice as long, a tenth of this is no more exact than an encoder."""
MARGIN_BEFORE_CONTACT_CHANGE, MARGIN_AFTER_CONTACT_CHANGE = 0.06, 0.06
"""Around where the load comes or goes [s], what is not compared: it has spikes there, of a millisecond or so, that no
laboratory samples (assumed; see the tests of the replay). One is up to 45 ms before a foot is off the ground, when all
but the last of its sole has left."""
END_MARGIN = 0.06
"""At the end of a trial [s], what is not compared: the ankle's acceleration is not known there."""
STEADY_MOMENT_RATE = 30.0
"""Rate of the load's moment [N.m/s] below which it is steady."""
COP_PERTURBATION = 1e-3
"""By how much the centre of pressure is moved to see what its noise does [m]."""
MIN_SWING_TIME = 0.1
"""Time without load before a foot strike, at least [s]: a foot may bounce as it comes or leaves (assumed; swing takes
some 0.4 s)."""


@dataclass(frozen=True, eq=False)
class GaitExperiment(Experiment):
    """A trial of several strides."""

    foot: Foot = field(kw_only=True)
    """Without effects of the body."""
    inputs: ReplayInputs = field(kw_only=True)
    """One of each per step; the command is :attr:`command`."""
    smoothed_inputs: ReplayInputs = field(kw_only=True)
    """The same of a motion that was smoothed with half the cutoff."""
    vertical_load: Array = field(kw_only=True)
    """Vertical [N], one per step."""
    foot_strikes: Array = field(kw_only=True)
    """Foot strikes, since the beginning [s]; two or more."""
    mean_stride_time: float = field(kw_only=True)
    """Duration of a stride, on average in all repeats [s]."""

    @cached_property
    def coarse_variant(self) -> Experiment:
        """See :class:`Experiment`."""
        if self.dt > TIME_STEP:
            return self
        inputs, smoother = (
            ReplayInputs(*(s[::COARSE_STEP_FACTOR] for s in every)) for every in (self.inputs, self.smoothed_inputs)
        )
        few, load = self.command[::COARSE_STEP_FACTOR], self.vertical_load[::COARSE_STEP_FACTOR]
        return replace(
            self,
            dt=self.dt * COARSE_STEP_FACTOR,
            inputs=inputs,
            smoothed_inputs=smoother,
            command=few,
            vertical_load=load,
        )

    @cached_property
    def preparation_variants(self) -> tuple[Experiment, ...]:
        """See :class:`Experiment`."""
        return (replace(self, inputs=self.smoothed_inputs),)

    @property
    def prescribed_input(self) -> PrescribedInput:
        """See :class:`Experiment`."""
        motions = ("unloading", "steady", "loading")
        return PrescribedInput(
            "load about the ankle [N·m]", 1.0, -self.inputs.ground_moment, STEADY_MOMENT_RATE, motions
        )

    @property
    def has_body(self) -> bool:
        """See :class:`Experiment`."""
        return True

    @property
    def informative_channels(self) -> tuple[str, ...]:
        """See :class:`Experiment`."""
        return "force", "ankle_angle", "muscle_length"

    @property
    def length_range(self) -> float:
        """As far as the load would move the unit against the return spring alone."""
        return float(np.ptp(self.inputs.ground_moment)) / self.foot.spring_stiffness * moment_arm(self.foot, 0.0)

    def simulate(self, setup: SimulationSetup) -> DeviceResponse:
        """See :class:`Experiment`; at the beginning of each step."""
        given = effects.select_effects(self.device.spec.effects, "body")
        foot = catalogue.apply_body_effects(
            given | {(one.effect, one.form): dict(one.parameters) for one in setup.body_edits}, self.foot
        )
        found = simulate_replay(setup.parameters, foot, self.inputs._replace(pressure_command=self.command), self.dt)
        time: Array = self.start_time + self.dt * np.arange(float(len(self.command)))
        return DeviceResponse(time, found.tension, found.pressure, found.length, found.ankle_angle, found.ankle_moment)

    def perturb_inputs(self, delay: Callable[[Array], Array]) -> tuple[Experiment, Experiment, Experiment]:
        """See :class:`Experiment`; what else is prescribed is where the load acts."""
        moved = self.inputs._replace(ground_moment=self.inputs.ground_moment - COP_PERTURBATION * self.vertical_load)
        return (
            replace(self, command=self.command + PRESSURE_PERTURBATION),
            replace(self, inputs=moved),
            replace(self, command=delay(self.command)),
        )

    def compute_covariates(self) -> dict[str, Array]:
        """See :class:`Experiment`."""
        since = np.linspace(0.0, self.duration, len(self.command))
        return {
            "phase": self.compute_stride_phase(since) % 1.0,
            "pressure": self.command,
            "pressure change": self.smooth(np.abs(np.gradient(self.command, self.dt))),
            "time": since,
        }

    def with_repeats(self, repeats: Sequence[Experiment]) -> Experiment:
        """See :class:`Experiment`."""
        return replace(
            self,
            mean_stride_time=float(np.mean([e.mean_stride_time for e in repeats if isinstance(e, GaitExperiment)])),
        )

    def compute_stride_phase(self, elapsed: Array) -> Array:
        """Strides since the first foot strike, and the phase of the present one, ``since`` [s] the beginning.

        Before the first strike and after the last, strides take as long as those next to them.
        """
        strides = np.arange(len(self.foot_strikes), dtype=np.float64)
        first, last = self.foot_strikes[1] - self.foot_strikes[0], self.foot_strikes[-1] - self.foot_strikes[-2]
        found = np.interp(elapsed, self.foot_strikes, strides)
        found = np.where(elapsed < self.foot_strikes[0], (elapsed - self.foot_strikes[0]) / first, found)
        late = strides[-1] + (elapsed - self.foot_strikes[-1]) / last
        return np.where(elapsed > self.foot_strikes[-1], late, found)

    def align_time(self, elapsed: Array) -> Array:
        """Strides of repeats are matched by their phase, whatever they take."""
        return self.mean_stride_time * self.compute_stride_phase(elapsed)


def prepare_gait_trial(trial: Trial, use: Use) -> GaitExperiment:
    """``trial`` made ready; raises InputError for one that cannot be replayed."""
    ready = prepare_prescribed_motion(trial.prescribed, f"trial '{trial.name}'")
    smoother = prepare_prescribed_motion(trial.prescribed, f"trial '{trial.name}'", cutoff=0.5 * CUTOFF_FREQUENCY_HZ)
    grid: Array = ready.start_time + TIME_STEP * np.arange(
        float(int((ready.end_time - ready.start_time) / TIME_STEP + 1e-6))
    )
    inputs = ready.interpolate(grid)
    strikes = _find_foot_strikes(ready, f"trial '{trial.name}'")
    return GaitExperiment(
        name=trial.name,
        group=trial.group,
        use=use,
        device=trial.device,
        start_time=ready.start_time,
        dt=TIME_STEP,
        command=inputs.pressure_command,
        measured=_exclude_contact_changes(
            select_samples(trial, ready.start_time, ready.end_time, ready.end_time - END_MARGIN), ready
        ),
        trusted=trial.trusted,
        foot=build_device_foot(_remove_body_effects(trial.device)),
        inputs=inputs,
        smoothed_inputs=smoother.interpolate(grid),
        vertical_load=np.interp(grid, ready.vertical_load.time, ready.vertical_load.value),
        foot_strikes=strikes,
        mean_stride_time=float(np.mean(np.diff(strikes))),
    )


def _remove_body_effects(device: Device) -> Device:
    """Without effects of the body."""
    kept = {name: own for name, own in device.spec.effects.items() if catalogue.get_effects()[name].kind != "body"}
    return replace(device, spec=device.spec.model_copy(update={"effects": kept}))


def _find_foot_strikes(trajectory: PrescribedMotion, where: str) -> Array:
    """Times of the foot strikes that begin a stride, since the beginning [s]."""
    up, down = trajectory.find_foot_strikes(), trajectory.find_toe_offs()
    swung = [
        k
        for k in up
        if not ((down > k - MIN_SWING_TIME) & (down < k)).any()
        and k - MIN_SWING_TIME > trajectory.vertical_load.time[0]
    ]
    if len(swung) < 2:
        raise InputError(
            f"{where}: its load shows {len(swung)} foot strikes; a gait trial needs 2 or more, each after a swing, "
            "better 5"
        )
    return np.array(swung) - trajectory.start_time


def _exclude_contact_changes(measured: Mapping[str, Series], trajectory: PrescribedMotion) -> dict[str, Series]:
    """``measured`` without what is around where the load comes and goes."""
    found = {}
    for channel, series in measured.items():
        good = np.ones(len(series.time), dtype=np.bool_)
        for event in (*trajectory.find_foot_strikes(), *trajectory.find_toe_offs()):
            good &= (series.time < event - MARGIN_BEFORE_CONTACT_CHANGE) | (
                series.time > event + MARGIN_AFTER_CONTACT_CHANGE
            )
        found[channel] = Series(series.time[good], series.value[good])
    return found
