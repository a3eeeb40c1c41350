"""Trials of a mechanism: pressures, motion and loads are prescribed in an MJCF model with devices on its tendons."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline

from klute_sim.datasets.mechanism import DatasetMechanism, carry_error
from klute_sim.datasets.mechanism_channels import parse_channel
from klute_sim.datasets.trial import TimeSeries, Trial, Use
from klute_sim.device.dynamics import ZERO_INTERNAL_STATE, apply_supply_effects
from klute_sim.diagnosis.experiments.base import (
    CHANNEL_UNITS,
    PRESSURE_PERTURBATION,
    DeviceResponse,
    Experiment,
    NumberChange,
    PrescribedInput,
    SimulationSetup,
    select_samples,
)
from klute_sim.diagnosis.experiments.bench import (
    MOVING_WARM_UP_FRACTION,
    MOVING_WARM_UP_TIME,
    STATIONARY_SPEED,
)
from klute_sim.diagnosis.experiments.denoise import denoise
from klute_sim.diagnosis.experiments.initial_motion import (
    MOTION_QUANTITIES,
    begins_late,
    estimate_initial_position,
    estimate_initial_velocities,
    interpolate_finite,
    read_initial_pressures,
)
from klute_sim.diagnosis.experiments.interpolation import apply_zero_order_hold, denoise_command, list_other_commands
from klute_sim.diagnosis.experiments.registration import Registration
from klute_sim.diagnosis.experiments.time_step import COARSE_STEP_FACTOR, STEPS_PER_SAMPLE, choose_time_step
from klute_sim.errors import InputError
from klute_sim.laws.pneumatics import has_metered_flow
from klute_sim.mechanism.assembly import Binding, Mechanism, compute_unit_lengths
from klute_sim.mechanism.simulate import simulate_mechanism
from klute_sim.plant.mjcf.model_effects import JOINT_TYPES, list_parts
from klute_sim.types import Array

MIN_TIME_STEP, MAX_TIME_STEP = 2.5e-4, 1e-3
"""Limits of the time step [s] with a flow that is metered; others are twice as long (assumed: a stiff tendon on a light
lever needs the longest of these)."""
METERED_STEPS_PER_SAMPLE = COARSE_STEP_FACTOR * STEPS_PER_SAMPLE
"""Time steps per sample of the prescribed channels with a flow that is metered: it starts and stops within a step."""
POSITION_PERTURBATION = 1e-3
"""Change of a driven joint [rad or m] that measures the sensitivity to noise of its motion."""
KINEMATIC_RATE = 100.0
"""Positions per second [Hz] at which the lengths of the tendons are evaluated (assumed: between them, lines are off by
0.2 % of the amplitude of a motion of 2 Hz)."""
COMMAND_QUANTITY = "pressure_command"
PRESSURE_QUANTITIES = (COMMAND_QUANTITY, "pressure")


@dataclass(frozen=True, eq=False)
class MechanismExperiment(Experiment):
    """A trial of a mechanism."""

    mechanism: Mechanism = field(kw_only=True)
    """Model, devices and prescribed channels."""
    outputs: Mapping[str, Binding] = field(kw_only=True)
    """Measured channel -> object of the model."""
    inputs: Mapping[str, Array] = field(kw_only=True)
    """Prescribed channel -> values [SI], one per time step."""
    other_inputs: tuple[tuple[Mapping[str, Array], ...], ...] = field(default=(), kw_only=True)
    """For each command with samples far apart: the inputs with its other interpolations."""
    zero_order_hold_commands: Mapping[str, Array] = field(default_factory=dict, kw_only=True)
    """Command that is not constant -> values [Pa] with a zero-order hold, one per time step."""
    numbers: Mapping[str, float] = field(kw_only=True)
    """Numbers of the model that differ from its file."""
    initial_positions: Mapping[str, float] = field(kw_only=True)
    """Joint -> measured or stated position [m or rad] near which the trial begins."""
    initial_velocities: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    """Joint -> measured or stated velocity [m/s or rad/s] at the start; empty where the trial begins at rest."""
    initial_pressures: Mapping[str, float] = field(default_factory=dict, kw_only=True)
    """Device -> pressure [Pa] at the start: stated, or measured where the trial begins in motion."""
    unit_length: Array | None = field(default=None, kw_only=True)
    """Length of the first device [m], one value per time step; None where a joint was neither driven nor measured."""

    @cached_property
    def coarse_variant(self) -> Experiment:
        """The same trial with time steps of twice the length."""
        factor = COARSE_STEP_FACTOR
        return replace(
            self,
            dt=self.dt * factor,
            inputs={name: values[factor - 1 :: factor] for name, values in self.inputs.items()},
            command=self.command[factor - 1 :: factor],
            unit_length=None if self.unit_length is None else self.unit_length[factor - 1 :: factor],
            other_inputs=(),
            zero_order_hold_commands={},
        )

    def select_variant(self, setup: SimulationSetup) -> Experiment:
        """Return the trial with steps of twice the length, unless a valve or a tank meters the flow into a device."""
        parameters = setup.devices or tuple(device.parameters for device in self.devices.values())
        supplies = (apply_supply_effects(device, ZERO_INTERNAL_STATE) for device in parameters)
        return self if any(map(has_metered_flow, supplies)) else self.coarse_variant

    @property
    def zero_order_hold_variant(self) -> Experiment | None:
        """The trial with a zero-order hold of the commands; None where all are constant."""
        if not self.zero_order_hold_commands:
            return None
        name = next(name for name, values in self.inputs.items() if values is self.command)
        inputs = {**self.inputs, **self.zero_order_hold_commands}
        return replace(
            self,
            inputs=inputs,
            command=inputs[name],
            other_inputs=(),
            zero_order_hold_commands={},
            has_zero_order_hold=True,
            noisy_variants=self.zero_order_hold_noisy_variants,
        )

    @property
    def input_variants(self) -> tuple[tuple[Experiment, ...], ...]:
        """The trial with commands that are held before or after each sample."""
        plain = replace(self, other_inputs=())
        return tuple(tuple(replace(plain, inputs=inputs) for inputs in variants) for variants in self.other_inputs)

    @property
    def prescribed_input(self) -> PrescribedInput:
        """The first driven joint, or the first load, or the pressure of the last device."""
        name = next((n for n in self.inputs if parse_channel(n).quantity in MOTION_QUANTITIES), "")
        name = name or next((n for n in self.inputs if parse_channel(n).quantity.startswith("external")), "")
        name = name or list(self.inputs)[-1]
        unit, si_factor = CHANNEL_UNITS[name]
        values = self.inputs[name]
        label = f"{name.replace('_', ' ')} [{unit}]"
        stationary_rate = 0.01 * float(np.ptp(values)) if np.ptp(values) > 0.0 else si_factor
        return PrescribedInput(label, si_factor, values, stationary_rate, ("falling", "stationary", "rising"))

    @property
    def has_body(self) -> bool:
        """False: effects of the body belong to the prosthesis."""
        return False

    @cached_property
    def parts(self) -> Mapping[str, Sequence[str]]:
        """Joints that are not driven, pulleys, the rig, and measured positions of joints."""
        driven = self.mechanism.driven_joints
        parts: dict[str, Sequence[str]] = {
            kind: [name for name in names if name not in driven]
            for kind, names in list_parts(self.mechanism.spec).items()
        }
        positions = [n for n, b in self.outputs.items() if b.channel.quantity in MOTION_QUANTITIES]
        return {**parts, "position channel": positions}

    @cached_property
    def joint_kinds(self) -> Mapping[str, str]:
        """Joint that is not driven -> kind of part; empty unless :attr:`has_known_motion`."""
        kinds = {name: kind for kind in JOINT_TYPES for name in self.parts.get(kind, ())}
        return kinds if self.has_known_motion else {}

    @property
    def has_known_motion(self) -> bool:
        """Whether the position of every joint is prescribed or measured."""
        measured = {b.name for b in self.outputs.values() if b.channel.quantity in MOTION_QUANTITIES}
        known = measured | set(self.mechanism.driven_joints)
        return all(joint.name in known for joint in self.mechanism.spec.joints)

    @property
    def informative_channels(self) -> tuple[str, ...]:
        """All channels but pressures; they depend on the forces of the devices."""
        names = [name for name in self.outputs if parse_channel(name).quantity not in PRESSURE_QUANTITIES]
        return tuple(names) or ("force",)

    @property
    def pressure_range(self) -> float:
        """Largest range of a pressure command [Pa]."""
        commands = [values for name, values in self.inputs.items() if parse_channel(name).quantity == COMMAND_QUANTITY]
        return max(float(np.ptp(values)) for values in (self.command, *commands))

    @property
    def length_range(self) -> float | None:
        """Range of the length of the first device [m]; None where it is unknown."""
        return None if self.unit_length is None else float(np.ptp(self.unit_length))

    def simulate(self, setup: SimulationSetup) -> DeviceResponse:
        """Simulate from rest under the first inputs, or from the measured initial motion."""
        parameters = setup.devices or tuple(device.parameters for device in self.devices.values())
        delay = Registration(*setup.registration).command_delay
        rollout = simulate_mechanism(
            self.mechanism,
            dict(zip(self.devices, parameters, strict=True)),
            self._delay_other_inputs(delay / self.dt) if delay != 0.0 else self.inputs,
            self.dt,
            numbers={**self.numbers, **dict(setup.model_numbers)},
            initial_positions=self.initial_positions,
            initial_velocities=self.initial_velocities,
            initial_pressures=self.initial_pressures,
            effects=setup.model_effects,
        )
        first = rollout.trace_device(next(iter(self.devices)))
        channels = {name: rollout.read_channel(binding) for name, binding in self.outputs.items()}
        time = self.start_time + self.dt - delay + rollout.time
        return DeviceResponse(time, first.tension, first.pressure, first.length, channels=channels)

    def _delay_other_inputs(self, n_steps: float) -> dict[str, Array]:
        """Return :attr:`inputs` with all but the commands later by ``n_steps`` time steps."""
        steps = np.arange(len(self.command), dtype=np.float64)
        return {
            name: values
            if parse_channel(name).quantity == COMMAND_QUANTITY
            else np.interp(steps - n_steps, steps, values)
            for name, values in self.inputs.items()
        }

    def correct_model_numbers(self, changes: Mapping[str, NumberChange]) -> dict[str, float]:
        """Return the changed numbers; one that the trial overrides has the error of the declared one."""
        return {
            name: carry_error(name, declared, value, self.numbers.get(name, declared))
            for name, (declared, value) in changes.items()
        }

    def perturb_inputs(self, delay: Callable[[Array], Array]) -> tuple[Experiment, Experiment, Experiment]:
        """Perturb all pressures, perturb all driven joints, and delay all pressures."""

        def change(quantities: tuple[str, ...], function: Callable[[Array], Array]) -> Experiment:
            inputs = {
                name: function(values) if parse_channel(name).quantity in quantities else values
                for name, values in self.inputs.items()
            }
            return replace(self, inputs=inputs)

        return (
            change(PRESSURE_QUANTITIES, lambda values: values + PRESSURE_PERTURBATION),
            change(MOTION_QUANTITIES, lambda values: values + POSITION_PERTURBATION),
            change(PRESSURE_QUANTITIES, lambda values: delay(delay(values))),  # the usual steps are twice as long
        )

    def compute_covariates(self) -> dict[str, Array]:
        """Return pressure and, where it is known, length of the first device, with their rates, and time."""
        step = self.duration / len(self.command)
        covariates = {
            "pressure": self.command,
            "pressure change": self.smooth(np.abs(np.gradient(self.command, step))),
            "time": np.linspace(0.0, self.duration, len(self.command)),
        }
        if self.unit_length is not None and np.ptp(self.unit_length) > STATIONARY_SPEED * step:
            covariates["length"] = self.unit_length
            covariates["speed"] = self.smooth(np.gradient(self.unit_length, step))
        return covariates


def prepare_mechanism_trial(declared: DatasetMechanism, trial: Trial, use: Use) -> MechanismExperiment:
    """Return the experiment of a ``trial`` of the mechanism that the dataset ``declared``.

    Raises InputError when a channel has no object in the model.
    """
    try:
        mechanism = Mechanism(declared.file, tuple(declared.devices), declared.channels.prescribed)
        outputs = {name: mechanism.bind(parse_channel(name)) for name in declared.channels.measured}
    except InputError as error:
        raise InputError(f"trial '{trial.name}': {error}") from None
    series = trial.prescribed
    start_time = max(s.time[0] for s in series.values())
    end_time = min(s.time[-1] for s in series.values())
    interval = min(s.sampling_interval for s in series.values())
    dt = choose_time_step(
        interval, MIN_TIME_STEP, MAX_TIME_STEP, METERED_STEPS_PER_SAMPLE, merged_steps=COARSE_STEP_FACTOR**2
    )
    time = start_time + dt * np.arange(1, int((end_time - start_time) / dt + 1e-6) + 1)
    inputs = {name: _interpolate(name, samples, time) for name, samples in series.items()}
    other_inputs = tuple(
        tuple({**inputs, name: values} for values in variants)
        for name, samples in series.items()
        if (variants := _list_other_interpolations(name, samples, time))
    )
    zero_order_hold_commands = {
        name: values
        for name, samples in series.items()
        if parse_channel(name).quantity == COMMAND_QUANTITY
        and (values := apply_zero_order_hold(time, dt, samples)) is not None
    }
    pressure_name = next(n for n, b in mechanism.bindings.items() if b.name == next(iter(declared.devices)))
    positions = {
        binding.name: interpolate_finite(trial.measured[name], time)
        for name, binding in outputs.items()
        if name in trial.measured and binding.channel.quantity in MOTION_QUANTITIES
    }
    stated = trial.initial_state
    initial_positions = {
        binding.name: estimate_initial_position(trial.measured[name], start_time)
        for name, binding in outputs.items()
        if binding.name in positions and not begins_late(trial.measured[name], start_time)
    }
    estimated = estimate_initial_velocities(trial, outputs, start_time)
    velocities = {**estimated, **stated.velocities}
    warm_up = {"max_warm_up_fraction": MOVING_WARM_UP_FRACTION, "max_warm_up_time": MOVING_WARM_UP_TIME}
    driven = {b.name: inputs[n] for n, b in mechanism.bindings.items() if b.channel.quantity in MOTION_QUANTITIES}
    return MechanismExperiment(
        name=trial.name,
        group=trial.group,
        use=use,
        device=trial.device,
        devices=trial.devices,
        start_time=start_time,
        dt=dt,
        command=inputs[pressure_name],
        measured=select_samples(trial, start_time, end_time, time[-1], **(warm_up if estimated else {})),
        trusted=trial.trusted,
        limits=trial.limits,
        specimen=trial.specimen,
        mechanism=mechanism,
        outputs={name: binding for name, binding in outputs.items() if name in trial.measured},
        inputs=inputs,
        other_inputs=other_inputs,
        zero_order_hold_commands=zero_order_hold_commands,
        command_interval=max(
            (s.sampling_interval for name, s in series.items() if parse_channel(name).quantity == COMMAND_QUANTITY),
            default=0.0,
        ),
        numbers=trial.model_numbers,
        initial_positions=initial_positions | dict(stated.positions),
        initial_velocities=velocities,
        initial_pressures=(read_initial_pressures(trial, outputs, start_time) if velocities else {})
        | dict(stated.pressures),
        unit_length=_compute_first_length(mechanism, trial.model_numbers, {**positions, **driven}, time),
    )


def _interpolate(name: str, samples: TimeSeries, time: Array) -> Array:
    """Return a prescribed channel at ``time`` [s]; a motion is smooth, because its acceleration moves the bodies."""
    quantity = parse_channel(name).quantity
    if quantity == COMMAND_QUANTITY:
        return np.interp(time, samples.time, denoise_command(samples))
    values = denoise(samples.time, samples.value)
    if quantity in MOTION_QUANTITIES:
        return np.asarray(CubicSpline(samples.time, values)(time), dtype=np.float64)
    return np.interp(time, samples.time, values)


def _list_other_interpolations(name: str, samples: TimeSeries, time: Array) -> tuple[Array, ...]:
    is_command = parse_channel(name).quantity == COMMAND_QUANTITY
    return list_other_commands(time, samples) if is_command else ()


def _compute_first_length(
    mechanism: Mechanism, numbers: Mapping[str, float], positions: Mapping[str, Array], time: Array
) -> Array | None:
    """Return the length of the first device [m] at ``time`` [s]; None unless all joints have known positions."""
    joints = [joint.name for joint in mechanism.spec.joints]
    if not set(joints) <= positions.keys():
        return None
    n_samples = 1 + int(np.ceil(KINEMATIC_RATE * (time[-1] - time[0])))
    samples = np.linspace(time[0], time[-1], min(len(time), n_samples))
    sampled = {name: np.interp(samples, time, values) for name, values in positions.items()}
    lengths = compute_unit_lengths(mechanism, numbers, sampled)
    return np.interp(time, samples, lengths[mechanism.device_names[0]])
