"""Simulate a device under lengths and pressure commands of the user's own: :func:`simulate_response`."""

import math

import numpy as np
from numpy.typing import ArrayLike

from klute_sim.api.inputs import DeviceLike, to_device
from klute_sim.bench.validation import validate_inputs
from klute_sim.device.device import check_accepts_pressure
from klute_sim.device.rollout import simulate_rollouts
from klute_sim.diagnosis.experiments.interpolation import interpolate_smoothly
from klute_sim.errors import InputError
from klute_sim.provenance import collect_versions
from klute_sim.recording.recording import Recording
from klute_sim.types import Array
from klute_sim.units import BAR


def simulate_response(
    device: DeviceLike,
    time_s: ArrayLike,
    length_mm: ArrayLike,
    pressure_command_bar: ArrayLike,
    *,
    zero_order_hold: bool = False,
    time_step: float = 1e-4,
) -> Recording:
    """Simulate ``device`` under a prescribed length and pressure command, and return its response at the same times.

    The device begins at rest, with a taut tendon. Channels of the recording: time [s], length [mm], pressure_command
    [bar], force [N] of the whole unit, pressure [bar] in the muscle and muscle_length [mm].

    Args:
        device: Device, name of a preset, or path of a device file.
        time_s: Times of the samples [s], increasing, (samples,).
        length_mm: Length of the whole muscle-tendon unit [mm], (samples,); between samples it follows a smooth curve.
        pressure_command_bar: Commanded gauge pressure [bar], (samples,), or one number for all.
        zero_order_hold: Whether each command is held until the next sample; False: it is interpolated linearly.
        time_step: Longest time step [s]; the error of the response is in proportion to it.

    Raises InputError when the series do not match, are not finite or are out of the range of the device. Raises
    SimulationError when the response is not finite.
    """
    device = to_device(device)
    time = np.asarray(time_s, dtype=np.float64)
    if time.ndim != 1 or len(time) < 2:
        raise InputError(f"time_s has the shape {time.shape}; it needs one axis with at least two samples")
    if not (np.isfinite(time).all() and np.diff(time).min() > 0.0):
        raise InputError("time_s must be finite and increase from each sample to the next")
    length = _read_series("length_mm", length_mm, time)
    command = _read_series("pressure_command_bar", pressure_command_bar, time)
    check_accepts_pressure(device, "simulate_response")
    max_bar = device.parameters.supply.max_pressure / BAR
    if command.min() < 0.0 or command.max() > max_bar:
        raise InputError(
            f"pressure_command_bar runs from {command.min():g} to {command.max():g}; the supply of '{device.name}' "
            f"allows 0 to {max_bar:g} bar"
        )
    if not 0.0 < time_step < math.inf:
        raise InputError(f"time_step is {time_step:g} s; it must be above 0")
    n_steps = math.ceil((time[-1] - time[0]) / time_step * (1.0 - 1e-12))
    grid = np.linspace(time[0], time[-1], n_steps + 1)
    dt = float(time[-1] - time[0]) / n_steps
    # A time step ends at its time of the grid, and has one command.
    last = np.maximum(np.searchsorted(time, grid - 0.5 * dt, side="right") - 1, 0)
    commands = command[last] if zero_order_hold else np.interp(grid, time, command)
    inputs = validate_inputs(device, 1e-3 * interpolate_smoothly(grid, time, length), BAR * commands, dt)
    trace = simulate_rollouts(device.parameters, *inputs, dt, n_jobs=1)
    columns = [
        ("time [s]", time),
        ("length [mm]", length),
        ("pressure_command [bar]", command),
        ("force [N]", np.interp(time, grid, trace.tension)),
        ("pressure [bar]", np.interp(time, grid, trace.pressure) / BAR),
        ("muscle_length [mm]", 1e3 * np.interp(time, grid, trace.length)),
    ]
    provenance = {
        "rig": "bench",
        "device": {"name": device.name, "sha256": device.digest},
        "options": {"step_s": dt, "zero_order_hold": zero_order_hold},
        "versions": collect_versions(),
    }
    return Recording.from_columns(columns, provenance)


def _read_series(name: str, values: ArrayLike, time: Array) -> Array:
    """Return ``values`` with one entry per ``time``; raises InputError where they do not match or are not finite."""
    series = np.asarray(values, dtype=np.float64)
    if series.shape not in ((), time.shape):
        raise InputError(f"{name} has the shape {series.shape}, but time_s has {time.shape}; each time needs one value")
    if not np.isfinite(series).all():
        raise InputError(f"{name} must be finite everywhere")
    return np.broadcast_to(series, time.shape).copy()
