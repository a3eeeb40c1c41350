"""Bench trials: a tensile tester prescribes the length of the muscle-tendon unit."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from klute_sim.datasets.trial import TimeSeries, Trial, Use
from klute_sim.device.dynamics import (
    DEAD_TIME_INDEX,
    ZERO_INTERNAL_STATE,
    DeviceParameters,
    apply_supply_effects,
    get_dead_time,
)
from klute_sim.device.equilibrium import compute_resting_state
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.experiments.base import (
    PRESSURE_PERTURBATION,
    DeviceResponse,
    Experiment,
    PrescribedInput,
    SimulationSetup,
    select_samples,
)
from klute_sim.diagnosis.experiments.denoise import denoise
from klute_sim.diagnosis.experiments.interpolation import (
    apply_zero_order_hold,
    denoise_command,
    interpolate_smoothly,
    list_other_commands,
    list_other_lengths,
)
from klute_sim.diagnosis.experiments.registration import Registration
from klute_sim.diagnosis.experiments.time_step import COARSE_STEP_FACTOR, choose_time_step
from klute_sim.laws.pneumatics import has_metered_flow
from klute_sim.types import Array

MIN_TIME_STEP, MAX_TIME_STEP = 5e-4, 5e-3
"""Limits of the time step [s]. Below, the integration error vanishes in a load cell's noise; above, steps need not be
longer."""
SUPPLY_SUBSTEPS = 10
"""Divisor of the time step for a supply with a valve or a tank, whose flow starts and stops within a step. No
extrapolation corrects that: its error is 0.03 (valve) and 0.06 (tank) times the noise of a gauge in data of 200 Hz."""
LENGTH_PERTURBATION = -1e-4
"""Change of the prescribed length [m] that measures the sensitivity to length noise; a bare muscle can only shorten."""
STATIONARY_SPEED = 1e-3
"""Speed [m/s] below which the rig counts as stationary."""
START_TIME_SPAN = 0.1
"""Time [s] at the start of a trial in which motion is looked for."""
REST_PRESSURE_CHANGE = 0.1e5
"""Change of the pressure or of its command in the first moments [Pa] up to which a trial begins at rest (assumed:
twice the error of an inexpensive gauge)."""
MOVING_WARM_UP_FRACTION, MOVING_WARM_UP_TIME = 0.3, 1.5
"""Fraction of a trial, and longest time [s], that is not compared where it begins in motion: its internal states are
unknown (assumed: several time constants of a slow valve)."""


@dataclass(frozen=True, eq=False)
class BenchExperiment(Experiment):
    """A trial on the bench."""

    unit_length: Array = field(kw_only=True)
    """Prescribed length of the muscle-tendon unit [m], one value per time step."""
    initial_pressure: float | None = field(default=None, kw_only=True)
    """Measured pressure [Pa] at the start of a trial that does not begin at rest; None: that of the command."""
    other_lengths: tuple[Array, ...] = field(default=(), kw_only=True)
    """Other interpolations of the length [m] between samples that are far apart."""
    other_commands: tuple[Array, ...] = field(default=(), kw_only=True)
    """Other interpolations of the command [Pa] between samples that are far apart."""
    zero_order_hold_command: Array | None = field(default=None, kw_only=True)
    """Command [Pa] with a zero-order hold, one value per time step; None where it is constant."""
    supply_substeps: int = field(default=SUPPLY_SUBSTEPS, kw_only=True)
    """Divisor of the time step for a supply with a valve or a tank."""

    @cached_property
    def coarse_variant(self) -> Experiment:
        """The same trial with time steps of up to :data:`MAX_TIME_STEP`."""
        factor = min(COARSE_STEP_FACTOR, int(MAX_TIME_STEP / self.dt + 1e-6))
        if factor < 2:
            return self
        length, command = self.unit_length[factor - 1 :: factor], self.command[factor - 1 :: factor]
        return replace(
            self,
            dt=self.dt * factor,
            unit_length=length,
            command=command,
            other_lengths=(),
            other_commands=(),
            zero_order_hold_command=None,
            supply_substeps=1,
        )

    def is_extrapolated(self, setup: SimulationSetup) -> bool:
        """Return whether the response to ``setup`` is extrapolated: not where the time step is divided."""
        return super().is_extrapolated(setup) and self._count_substeps(setup.parameters) == 1

    def _count_substeps(self, parameters: DeviceParameters) -> int:
        """Return into how many steps each time step is divided for the device."""
        supply = apply_supply_effects(parameters, ZERO_INTERNAL_STATE)
        return self.supply_substeps if has_metered_flow(supply) else 1

    @property
    def input_variants(self) -> tuple[tuple[Experiment, ...], ...]:
        """The trial with straight lines between lengths, and with commands held before or after each sample."""
        plain = replace(self, other_lengths=(), other_commands=())
        by_input = (
            tuple(replace(plain, unit_length=length) for length in self.other_lengths),
            tuple(replace(plain, command=command) for command in self.other_commands),
        )
        return tuple(variants for variants in by_input if variants)

    @property
    def zero_order_hold_variant(self) -> Experiment | None:
        """The trial with a zero-order hold of the command; None where it is constant."""
        if self.zero_order_hold_command is None:
            return None
        return replace(
            self,
            command=self.zero_order_hold_command,
            zero_order_hold_command=None,
            other_commands=(),
            has_zero_order_hold=True,
            noisy_variants=self.zero_order_hold_noisy_variants,
        )

    @property
    def prescribed_input(self) -> PrescribedInput:
        """Prescribed length of the muscle-tendon unit."""
        directions = ("shortening", "still", "lengthening")
        return PrescribedInput("prescribed length [mm]", 1e-3, self.unit_length, STATIONARY_SPEED, directions)

    @property
    def has_body(self) -> bool:
        """False: the bench tests the device alone."""
        return False

    @property
    def informative_channels(self) -> tuple[str, ...]:
        """Force and muscle length."""
        return "force", "muscle_length"

    @property
    def length_range(self) -> float:
        """Range of the prescribed length [m]."""
        return float(np.ptp(self.unit_length))

    def simulate(self, setup: SimulationSetup) -> DeviceResponse:
        """Simulate from rest at the first inputs; values are those after each time step.

        The time grid is shifted to the corners of a command that is delayed, or whose log is: otherwise a rate limit
        would act up to one time step early.
        """
        parameters, length, command, dt = setup.parameters, self.unit_length, self.command, self.dt
        initial_command = float(command[0]) if self.initial_pressure is None else self.initial_pressure
        initial_state = compute_resting_state(parameters, float(length[0]), initial_command, self.initial_friction)
        dead_time = get_dead_time(parameters)
        n_delay_steps = math.floor(dead_time / dt + 1e-9)
        shift = max(0.0, dead_time - n_delay_steps * dt)
        if shift > 0.0:
            effects = (
                *parameters.effects[:DEAD_TIME_INDEX],
                n_delay_steps * dt - (dead_time - parameters.effects[DEAD_TIME_INDEX]),
                *parameters.effects[DEAD_TIME_INDEX + 1 :],
            )
            parameters = parameters._replace(effects=effects)
        shift -= Registration(*setup.registration).command_delay
        n_substeps = self._count_substeps(parameters)
        steps = np.arange(len(length), dtype=np.float64)
        if shift != 0.0:
            length = np.interp(steps + shift / dt, steps, length)
        fine_steps = (np.arange(n_substeps * len(length)) + 1.0) / n_substeps - 1.0
        rollout = simulate_rollouts(
            parameters,
            np.interp(fine_steps, steps, length),
            np.interp(fine_steps, steps, command),
            dt / n_substeps,
            initial_state=initial_state,
            n_jobs=1,
        )
        time: Array = self.start_time + shift + dt * (steps + 1.0)
        tension, pressure, muscle_length = (values[n_substeps - 1 :: n_substeps] for values in rollout)
        return DeviceResponse(time, tension, pressure, muscle_length)

    def perturb_inputs(self, delay: Callable[[Array], Array]) -> tuple[Experiment, Experiment, Experiment]:
        """Perturb the pressure, perturb the length, and delay the command."""
        return (
            replace(self, command=self.command + PRESSURE_PERTURBATION),
            replace(self, unit_length=self.unit_length + LENGTH_PERTURBATION),
            replace(self, command=delay(self.command)),
        )

    def compute_covariates(self) -> dict[str, Array]:
        """Return pressure, length, their rates, and time."""
        speed = np.gradient(self.unit_length, self.duration / len(self.command))
        pressure_rate = np.gradient(self.command, self.duration / len(self.command))
        return {
            "pressure": self.command,
            "length": self.unit_length,
            "speed": self.smooth(speed),
            "pressure change": self.smooth(np.abs(pressure_rate)),
            "time": np.linspace(0.0, self.duration, len(self.command)),
        }


def prepare_bench_trial(trial: Trial, use: Use) -> BenchExperiment:
    """Return the experiment of a bench ``trial``."""
    length, command = trial.prescribed["length"], trial.prescribed["pressure_command"]
    start_time = max(length.time[0], command.time[0])
    end_time = min(length.time[-1], command.time[-1])
    interval = min(length.sampling_interval, command.sampling_interval)
    dt = choose_time_step(interval, MIN_TIME_STEP, MAX_TIME_STEP)
    time = start_time + dt * np.arange(1, int((end_time - start_time) / dt + 1e-6) + 1)
    is_moving = starts_in_motion(trial)
    warm_up = {"max_warm_up_fraction": MOVING_WARM_UP_FRACTION, "max_warm_up_time": MOVING_WARM_UP_TIME}
    if is_moving and trial.measured.keys() == {"pressure"}:
        warm_up = {"max_warm_up_time": 0.0}  # the state of the supply is known, and the muscle's does not matter
    return BenchExperiment(
        name=trial.name,
        group=trial.group,
        use=use,
        device=trial.device,
        start_time=start_time,
        dt=dt,
        unit_length=interpolate_smoothly(time, length.time, denoise(length.time, length.value)),
        command=np.interp(time, command.time, denoise_command(command)),
        measured=select_samples(trial, start_time, end_time, time[-1], **(warm_up if is_moving else {})),
        initial_pressure=_estimate_initial_pressure(trial, start_time) if is_moving else None,
        other_lengths=list_other_lengths(time, length),
        other_commands=list_other_commands(time, command),
        command_interval=command.sampling_interval,
        zero_order_hold_command=apply_zero_order_hold(time, dt, command),
        trusted=trial.trusted,
        limits=trial.limits,
        specimen=trial.specimen,
    )


def starts_in_motion(trial: Trial) -> bool:
    """Return whether a bench ``trial`` does not begin at rest: length, command or pressure change in its first moments.

    A measured pressure that differs from the command has not settled yet, unless it stays there.
    """
    length, command = trial.prescribed["length"], trial.prescribed["pressure_command"]
    start_time = max(length.time[0], command.time[0])
    if _compute_initial_change(length, start_time) > STATIONARY_SPEED * START_TIME_SPAN:
        return True
    if _compute_initial_change(command, start_time) > REST_PRESSURE_CHANGE:
        return True
    pressure = trial.measured.get("pressure")
    return pressure is not None and _compute_initial_change(pressure, start_time) > REST_PRESSURE_CHANGE


def _compute_initial_change(series: TimeSeries, start_time: float) -> float:
    """Return the change [SI] between the first and the last third of :data:`START_TIME_SPAN` from ``start_time`` on.

    A series that begins later counts from its first sample, and one without later samples does not change.
    """
    is_used = np.isfinite(series.value) & (series.time >= start_time)
    if not is_used.any():
        return 0.0
    time, value = series.time[is_used], series.value[is_used]
    values = value[time <= time[0] + START_TIME_SPAN]
    third = max(1, len(values) // 3)
    return abs(float(np.median(values[-third:]) - np.median(values[:third])))


def _estimate_initial_pressure(trial: Trial, start_time: float) -> float | None:
    """Return the first measured pressure [Pa] from ``start_time`` on; None if it was not measured."""
    pressure = trial.measured.get("pressure")
    if pressure is None:
        return None
    values = pressure.value[np.isfinite(pressure.value) & (pressure.time >= start_time)]
    return float(np.median(values[:3])) if len(values) else None
