"""Static loads of the devices of a mechanism at the recorded positions and pressures of a trial."""

from typing import NamedTuple

import mujoco
import numpy as np

from klute_sim.datasets.checks import compute_device_limits
from klute_sim.datasets.mechanism_channels import normalize_name
from klute_sim.datasets.mechanism_paths import find_moved_tendons, measure_lengths
from klute_sim.datasets.mechanism_statics import compute_static_tension
from klute_sim.datasets.trial import TimeSeries, Trial
from klute_sim.plausibility.exchanged_forces import Balance
from klute_sim.types import Array

N_MOMENTS = 60
"""Number of moments of a trial at which loads are computed."""
AVERAGING_TIME = 0.3
"""Time [s] over which samples are averaged (assumed: slower than lags of sensors and supplies)."""
MIN_DURATION = 3.0 * AVERAGING_TIME
"""Smallest duration [s] of a trial whose loads are computed (assumed)."""
ARM_STEP = 1e-4
"""Change of a joint [rad or m] that measures the arms of the tendons."""


class StaticLoad(NamedTuple):
    """Static force of a device, or moment of all devices about a hinge, at each moment."""

    value: Array
    """Force or moment [N or N m]; NaN where the laws of a device fail."""
    gross: Array
    """Sum of the magnitudes of the loads of the single devices [N or N m]."""
    max_load: float
    """Largest load of the devices [N or N m]."""


class TrialStatics:
    """Averaged samples of a trial, and the static loads that follow from positions and pressures."""

    def __init__(self, trial: Trial, model: mujoco.MjModel) -> None:
        """Average the positions and pressures of ``trial``, whose mechanism is ``model``."""
        self.trial, self.model = trial, model
        self.series = {**trial.prescribed, **trial.measured}
        start = max(series.time[0] for series in self.series.values())
        end = min(series.time[-1] for series in self.series.values())
        half = 0.5 * AVERAGING_TIME
        self.times = np.linspace(start + half, end - half, N_MOMENTS if end - start >= MIN_DURATION else 0)
        self.moved_tendons = find_moved_tendons(model)
        self.positions = {index: channel for index in range(model.njnt) if (channel := self._find_position(index))}

    def average(self, channel: str) -> Array:
        """Return the mean of the samples of ``channel`` around each moment; NaN where there is none."""
        return _average(self.series[channel], self.times)

    def compute_load(self, channel: str, mirrored: str = "") -> StaticLoad | None:
        """Return the load that ``channel`` measures, a force of a device or a moment about a hinge.

        None where positions or pressures that it depends on were not recorded. The position of the joint with channel
        ``mirrored`` is reversed.
        """
        if len(self.times) == 0:
            return None
        quantity, _, name = channel.partition("_")
        if quantity == "force":
            tendon = next(tendon for tendon in self.trial.devices if normalize_name(tendon) == name)
            return self._compute_force(tendon, measure_lengths(self.model, self._list_poses(mirrored)))
        hinge = next(index for index in range(self.model.njnt) if normalize_name(self.model.joint(index).name) == name)
        return self._compute_moment(hinge, mirrored)

    def has_free_joint(self) -> bool:
        """Return whether a joint moves by itself."""
        return any(channel not in self.trial.prescribed for channel in self.positions.values())

    def compute_balance(self, first: str, second: str) -> Balance | None:
        """Return the free joint between the devices of which the channels ``first`` and ``second`` are the forces.

        None where more joints are free, other devices move it, or an external load acts.
        """
        free = [index for index, channel in self.positions.items() if channel not in self.trial.prescribed]
        tendons = [
            next(t for t in self.trial.devices if f"force_{normalize_name(t)}" == name) for name in (first, second)
        ]
        if len(free) != 1 or any(name.startswith("external_") for name in self.trial.prescribed):
            return None
        others = [tendon for tendon in self.trial.devices if tendon not in tendons]
        if self.moved_tendons[self.positions[free[0]]] & {*others} or not self._has_only_devices():
            return None
        arms = self._measure_arms("", free[0])
        first_arm, second_arm = (arms[:, self.model.tendon(tendon).id] for tendon in tendons)
        return Balance(first_arm, second_arm, self._compute_passive_load(free[0]))

    def _find_position(self, index: int) -> str | None:
        name = normalize_name(self.model.joint(index).name)
        return next((channel for channel in (f"angle_{name}", f"position_{name}") if channel in self.series), None)

    def _knows_path(self, tendon: str) -> bool:
        """Return whether the positions of all joints that move ``tendon`` were recorded; those of balls never are."""
        scalar = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
        if any(int(kind) not in scalar for kind in self.model.jnt_type):
            return False
        moving = {channel for channel, tendons in self.moved_tendons.items() if tendon in tendons}
        unknown = [index for index in range(self.model.njnt) if index not in self.positions]
        names = [normalize_name(self.model.joint(index).name) for index in unknown]
        return not any(f"angle_{name}" in moving for name in names)

    def _list_poses(self, mirrored: str = "", moved: int = -1, step: float = 0.0) -> Array:
        """Return the positions of all joints at each moment; the joint ``moved`` is off by ``step`` [rad or m]."""
        poses = np.tile(self.model.qpos0, (len(self.times), 1))
        for index, channel in self.positions.items():
            sign, offset = -1.0 if channel == mirrored else 1.0, step if index == moved else 0.0
            poses[:, self.model.jnt_qposadr[index]] = sign * self.average(channel) + offset
        return poses

    def _measure_arms(self, mirrored: str, joint: int) -> Array:
        """Return the moment or force on ``joint`` per tension of each tendon [m or 1] at each moment."""
        low, high = (
            measure_lengths(self.model, self._list_poses(mirrored, joint, step)) for step in (-ARM_STEP, ARM_STEP)
        )
        return (low - high) / (2.0 * ARM_STEP)

    def _compute_passive_load(self, joint: int) -> Array:
        """Return the moment or force of gravity and springs on ``joint`` [N m or N] at each moment."""
        data, poses = mujoco.MjData(self.model), self._list_poses()
        loads = np.full(len(poses), np.nan)
        for index in np.flatnonzero(np.isfinite(poses).all(axis=1)):
            data.qpos[:] = poses[index]
            mujoco.mj_forward(self.model, data)
            loads[index] = data.qfrc_smooth[self.model.jnt_dofadr[joint]]
        return loads

    def _has_only_devices(self) -> bool:
        """Return whether the model has no other actuators than the devices."""
        devices = [self.model.tendon(tendon).id for tendon in self.trial.devices]
        return all(
            int(kind) == int(mujoco.mjtTrn.mjTRN_TENDON) and int(target) in devices
            for kind, target in zip(self.model.actuator_trntype, self.model.actuator_trnid[:, 0], strict=True)
        )

    def _compute_force(self, tendon: str, lengths: Array) -> StaticLoad | None:
        device, name = self.trial.devices[tendon], normalize_name(tendon)
        is_opening = device.parameters.supply.command_is_opening != 0.0
        sources = [f"pressure_{name}"] if is_opening else [f"pressure_{name}", f"pressure_command_{name}"]
        channel = next((source for source in sources if source in self.series), None)
        if channel is None or not self._knows_path(tendon):
            return None
        pressures, path = np.maximum(self.average(channel), 0.0), lengths[:, self.model.tendon(tendon).id]
        inputs = zip(pressures, path, strict=True)
        force = np.array(
            [
                compute_static_tension(device, float(pressure), float(length)) if np.isfinite(length) else np.nan
                for pressure, length in inputs
            ]
        )
        return StaticLoad(
            force, force, max(compute_device_limits(device).max_force, float(np.nanmax(force, initial=0.0)))
        )

    def _compute_moment(self, hinge: int, mirrored: str) -> StaticLoad | None:
        if not self._has_only_devices():
            return None
        lengths, arms = measure_lengths(self.model, self._list_poses(mirrored)), self._measure_arms(mirrored, hinge)
        value, gross, max_load = np.zeros(len(self.times)), np.zeros(len(self.times)), 0.0
        for tendon in self.trial.devices:
            index = self.model.tendon(tendon).id
            if not arms[:, index].any():
                continue
            force = self._compute_force(tendon, lengths)
            if force is None:
                return None
            value += arms[:, index] * force.value
            gross += np.abs(arms[:, index]) * force.value
            max_load += float(np.abs(arms[:, index]).max()) * force.max_load
        return StaticLoad(value, gross, max_load)


def _average(series: TimeSeries, times: Array) -> Array:
    """Return the mean of the finite samples of ``series`` around each of the ``times``; NaN where there is none."""
    is_finite = np.isfinite(series.value)
    time, total = series.time[is_finite], np.concatenate([[0.0], np.cumsum(series.value[is_finite])])
    first = np.searchsorted(time, times - 0.5 * AVERAGING_TIME)
    last = np.searchsorted(time, times + 0.5 * AVERAGING_TIME, side="right")
    number = last - first
    mean: Array = np.where(number > 0, (total[last] - total[first]) / np.maximum(number, 1), np.nan)
    return mean
