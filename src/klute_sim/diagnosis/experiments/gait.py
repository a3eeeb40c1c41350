"""Gait trials: the pylon follows the measured motion, the ground reaction loads the foot, and the ankle is free."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from klute_sim.datasets.trial import TimeSeries, Trial, Use
from klute_sim.device.schema import effects
from klute_sim.diagnosis.experiments.base import (
    MIN_SERIES_SAMPLES,
    PRESSURE_PERTURBATION,
    DeviceResponse,
    Experiment,
    PrescribedInput,
    SimulationSetup,
    select_samples,
)
from klute_sim.diagnosis.experiments.interpolation import apply_zero_order_hold
from klute_sim.diagnosis.experiments.registration import (
    NO_REGISTRATION_ERROR,
    REGISTRATION_DEVIATIONS,
    MeasuredInputs,
    PlateLoad,
    Registration,
    delay_inputs,
)
from klute_sim.diagnosis.experiments.time_step import COARSE_STEP_FACTOR
from klute_sim.effects import catalogue
from klute_sim.errors import InputError
from klute_sim.gait.contacts import find_contacts
from klute_sim.gait.replay.foot import build_bare_foot
from klute_sim.gait.replay.prescribed import PASS_CUTOFF_HZ, PrescribedMotion, prepare_prescribed_motion
from klute_sim.gait.replay.rollout import ReplayInputs, simulate_replay
from klute_sim.gait.rig.build import get_alignment
from klute_sim.laws.foot import Foot, moment_arm
from klute_sim.types import Array

TIME_STEP = 5e-4
"""Time step [s]. Extrapolated with one twice as long, it is as accurate as a tenth of it, to the resolution of an
encoder."""
MARGIN_BEFORE_CONTACT_CHANGE, MARGIN_AFTER_CONTACT_CHANGE = 0.06, 0.1
"""Times before and after a foot strike or toe-off [s] that are not compared. The response has spikes of about a
millisecond there, which no laboratory samples (assumed; see the tests of the replay). One occurs up to 45 ms before
toe-off, when only the tip of the sole is still loaded, and one 70 ms after foot strike, when the forefoot lands."""
END_MARGIN = 0.06
"""Time before the end of a trial [s] that is not compared, because the ankle's acceleration is unknown there."""
STEADY_MOMENT_RATE = 30.0
"""Rate of the ground reaction moment [N.m/s] below which it counts as steady."""
COP_PERTURBATION = 1e-3
"""Shift of the centre of pressure [m] that measures the sensitivity to its noise."""
SIMULATION_ERROR = 0.1
"""Error of the replay of a walk whose inputs have no noise, over the noise of usual instruments (measured on simulated
walks: 0.1 to 0.22 in the worst walk with most effects; docs/benchmark.md)."""
MIN_SWING_TIME = 0.1
"""Shortest time between the start of the load and the first foot strike [s], to know that a swing came before it
(assumed; swing takes about 0.4 s)."""


@dataclass(frozen=True, eq=False)
class GaitExperiment(Experiment):
    """A trial of several strides."""

    foot: Foot = field(kw_only=True)
    """Foot without effects of the body."""
    inputs: ReplayInputs = field(kw_only=True)
    """Inputs of the replay, one value per time step; :attr:`command` replaces their pressure command."""
    smoothed_inputs: ReplayInputs = field(kw_only=True)
    """Inputs from a motion that is low-pass filtered at half the cutoff frequency, 8 Hz."""
    load: PlateLoad = field(kw_only=True)
    """Vertical ground reaction and position of the ankle, one value per time step."""
    foot_strikes: Array = field(kw_only=True)
    """Times of foot strikes since the start [s]; at least two."""
    alignment: float = field(kw_only=True)
    """Alignment of the pylon to the limb [rad], dorsiflexion positive."""
    mean_stride_time: float = field(kw_only=True)
    """Mean stride time over all repeats [s]."""
    foot_change: Callable[[Foot], Foot] | None = field(default=None, kw_only=True)
    """Known change of the foot, after all effects; None without one."""
    zero_order_hold_command: Array | None = field(default=None, kw_only=True)
    """Command [Pa] with a zero-order hold, one value per time step; None for a constant one."""

    @cached_property
    def coarse_variant(self) -> Experiment:
        """The same trial with a time step twice as long."""
        if self.dt > TIME_STEP:
            return self
        inputs, smoothed_inputs = (
            ReplayInputs(*(values[::COARSE_STEP_FACTOR] for values in series))
            for series in (self.inputs, self.smoothed_inputs)
        )
        return replace(
            self,
            dt=self.dt * COARSE_STEP_FACTOR,
            inputs=inputs,
            smoothed_inputs=smoothed_inputs,
            command=self.command[::COARSE_STEP_FACTOR],
            zero_order_hold_command=None,
            load=self.load.map(lambda series: series[::COARSE_STEP_FACTOR]),
        )

    @cached_property
    def preparation_variants(self) -> tuple[Experiment, ...]:
        """The trial with inputs from a smoother motion."""
        return (replace(self, inputs=self.smoothed_inputs),)

    @property
    def zero_order_hold_variant(self) -> Experiment | None:
        """The trial with a zero-order hold of the command; None where it is constant."""
        if self.zero_order_hold_command is None:
            return None
        return replace(
            self,
            command=self.zero_order_hold_command,
            zero_order_hold_command=None,
            has_zero_order_hold=True,
            noisy_variants=self.zero_order_hold_noisy_variants,
        )

    @property
    def simulation_error(self) -> float:
        """RMS error of the replay over the noise [1]: time steps, low-pass filter of the motion, rigid heel."""
        return SIMULATION_ERROR

    @property
    def registration_deviations(self) -> Mapping[str, float]:
        """Distances, angles and delay between plate, markers and prosthesis."""
        return REGISTRATION_DEVIATIONS

    @property
    def prescribed_input(self) -> PrescribedInput:
        """Moment of the ground reaction about the ankle."""
        directions = ("unloading", "steady", "loading")
        return PrescribedInput(
            "load about the ankle [N·m]", 1.0, -self.inputs.ground_moment, STEADY_MOMENT_RATE, directions
        )

    @property
    def has_body(self) -> bool:
        """True: limb and foot are part of the replay."""
        return True

    @property
    def informative_channels(self) -> tuple[str, ...]:
        """Force, ankle angle and muscle length."""
        return "force", "ankle_angle", "muscle_length"

    @property
    def length_range(self) -> float:
        """Range of length [m] that the load would cause against the return spring alone."""
        return float(np.ptp(self.inputs.ground_moment)) / self.foot.spring_stiffness * moment_arm(self.foot, 0.0)

    def simulate(self, setup: SimulationSetup) -> DeviceResponse:
        """Simulate the replay; values are those at the start of each time step.

        A late log of the command is corrected by the times of all other channels: a time step has one command, and a
        regulator that limits the rate of the pressure responds to a part of a change as to all of it.
        """
        foot = self.build_foot(setup)
        registration = Registration(*setup.registration)
        inputs = delay_inputs(self.correct_inputs(registration), registration.command_delay / self.dt)
        replay = simulate_replay(setup.parameters, foot, inputs._replace(pressure_command=self.command), self.dt)
        time: Array = self.start_time + self.dt * np.arange(float(len(self.command)))
        return DeviceResponse(
            time - registration.command_delay,
            replay.tension,
            replay.pressure,
            replay.length,
            replay.ankle_angle + (self.alignment + registration.ankle_zero),
            replay.ankle_moment,
        )

    def correct_inputs(self, registration: Registration) -> ReplayInputs:
        """Return :attr:`inputs` under the errors of ``registration``, but for the delay of the command."""
        return self.inputs if registration == NO_REGISTRATION_ERROR else self._measured_inputs.correct(registration)

    @cached_property
    def _measured_inputs(self) -> MeasuredInputs:
        return MeasuredInputs(self.inputs, self.load, self.dt)

    def build_foot(self, setup: SimulationSetup) -> Foot:
        """Return the foot with the effects of the body of the device and of ``setup``, and with its known change."""
        body_effects = effects.select_effects(self.device.spec.effects, "body")
        edits = {(edit.effect, edit.form): dict(edit.parameters) for edit in setup.body_edits}
        foot = catalogue.apply_body_effects(body_effects | edits, self.foot)
        return foot if self.foot_change is None else self.foot_change(foot)

    def perturb_inputs(self, delay: Callable[[Array], Array]) -> tuple[Experiment, Experiment, Experiment]:
        """Perturb the pressure, shift the centre of pressure, and delay the command."""
        shifted = self.inputs._replace(ground_moment=self.inputs.ground_moment - COP_PERTURBATION * self.load.vertical)
        return (
            replace(self, command=self.command + PRESSURE_PERTURBATION),
            replace(self, inputs=shifted),
            replace(self, command=delay(self.command)),
        )

    def compute_covariates(self) -> dict[str, Array]:
        """Return stride phase, pressure, its rate, and time."""
        elapsed = np.linspace(0.0, self.duration, len(self.command))
        return {
            "phase": self.compute_stride_phase(elapsed) % 1.0,
            "pressure": self.command,
            "pressure change": self.smooth(np.abs(np.gradient(self.command, self.dt))),
            "time": elapsed,
        }

    def with_repeats(self, repeats: Sequence[Experiment]) -> Experiment:
        """Return the experiment with the mean stride time of its ``repeats``."""
        stride_times = [e.mean_stride_time for e in repeats if isinstance(e, GaitExperiment)]
        return replace(self, mean_stride_time=float(np.mean(stride_times)))

    def compute_stride_phase(self, elapsed: Array) -> Array:
        """Return strides since the first foot strike, at times ``elapsed`` since the start [s].

        The fractional part is the phase of the present stride. Before the first foot strike and after the last, the
        stride time is that of the adjacent stride.
        """
        strides = np.arange(len(self.foot_strikes), dtype=np.float64)
        first = self.foot_strikes[1] - self.foot_strikes[0]
        last = self.foot_strikes[-1] - self.foot_strikes[-2]
        phase = np.interp(elapsed, self.foot_strikes, strides)
        phase = np.where(elapsed < self.foot_strikes[0], (elapsed - self.foot_strikes[0]) / first, phase)
        phase_after_last = strides[-1] + (elapsed - self.foot_strikes[-1]) / last
        return np.where(elapsed > self.foot_strikes[-1], phase_after_last, phase)

    def align_time(self, elapsed: Array) -> Array:
        """Map the time since the start [s] so that strides of repeats match by phase, whatever their duration."""
        return self.mean_stride_time * self.compute_stride_phase(elapsed)


def prepare_gait_trial(trial: Trial, use: Use) -> GaitExperiment:
    """Return the experiment of a gait ``trial``; raises InputError for a trial that cannot be replayed."""
    where = f"trial '{trial.name}'"
    alignment = get_alignment(trial.device) or 0.0
    motion = prepare_prescribed_motion(trial.prescribed, where, alignment=alignment)
    smoothed_motion = prepare_prescribed_motion(
        trial.prescribed, where, pass_cutoff=0.5 * PASS_CUTOFF_HZ, alignment=alignment
    )
    n_steps = float(int((motion.end_time - motion.start_time) / TIME_STEP + 1e-6))
    time: Array = motion.start_time + TIME_STEP * np.arange(n_steps)
    inputs = motion.interpolate(time)
    foot_strikes = _find_foot_strikes(motion, where)
    samples = select_samples(trial, motion.start_time, motion.end_time, motion.end_time - END_MARGIN)
    return GaitExperiment(
        name=trial.name,
        group=trial.group,
        use=use,
        device=trial.device,
        start_time=motion.start_time,
        dt=TIME_STEP,
        command=inputs.pressure_command,
        zero_order_hold_command=apply_zero_order_hold(time + TIME_STEP, TIME_STEP, motion.pressure_command),
        command_interval=motion.pressure_command.sampling_interval,
        measured=_exclude_contact_changes(samples, motion),
        trusted=trial.trusted,
        limits=trial.limits,
        specimen=trial.specimen,
        alignment=alignment,
        foot=build_bare_foot(trial.device),
        inputs=inputs,
        smoothed_inputs=smoothed_motion.interpolate(time),
        load=PlateLoad(
            np.interp(time, motion.vertical_load.time, motion.vertical_load.value),
            motion.ankle_x(time),
            motion.ankle_z(time),
        ),
        foot_strikes=foot_strikes,
        mean_stride_time=float(np.mean(np.diff(foot_strikes))),
    )


def _find_foot_strikes(motion: PrescribedMotion, where: str) -> Array:
    """Return the times of the foot strikes of the trial that follow a swing, since its start [s]."""
    begin, end = max(motion.start_time, motion.vertical_load.time[0] + MIN_SWING_TIME), motion.end_time
    after_swing = [
        contact.foot_strike
        for contact in find_contacts(*motion.vertical_load)
        if contact.has_foot_strike and begin < contact.foot_strike <= end
    ]
    if len(after_swing) < 2:
        raise InputError(
            f"{where}: the vertical load shows {len(after_swing)} foot strikes after a swing; a gait trial needs at "
            "least 2, better 5"
        )
    return np.array(after_swing) - motion.start_time


def _exclude_contact_changes(measured: Mapping[str, TimeSeries], motion: PrescribedMotion) -> dict[str, TimeSeries]:
    """Return ``measured`` without the samples close to foot strikes and toe-offs, and without empty channels."""
    selected = {}
    for channel, series in measured.items():
        is_retained = np.ones(len(series.time), dtype=np.bool_)
        for event in (*motion.find_foot_strikes(), *motion.find_toe_offs()):
            is_retained &= (series.time < event - MARGIN_BEFORE_CONTACT_CHANGE) | (
                series.time > event + MARGIN_AFTER_CONTACT_CHANGE
            )
        if is_retained.sum() >= MIN_SERIES_SAMPLES:
            selected[channel] = TimeSeries(series.time[is_retained], series.value[is_retained])
    return selected
