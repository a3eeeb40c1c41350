"""Simulation of the measurements of a program: traces, instruments and noise."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from benchmarks.hidden_effects.air import AIR_STEP, AirSupply, is_coupled_to_motion, simulate_pressure
from benchmarks.hidden_effects.catalogue import BENCH_CHANNELS, instrument_forms
from benchmarks.hidden_effects.device import add_effects
from benchmarks.hidden_effects.inputs import SAMPLE_INTERVAL, InputProgram
from benchmarks.hidden_effects.law import Law
from benchmarks.hidden_effects.out_of_catalogue import apply_to_channels, apply_to_motion
from benchmarks.hidden_effects.truth import TRACE_STEP, DeviceInputs, integrate_device
from scipy.signal import lfilter

LENGTH_TOLERANCE = 1e-9  # m per step: see the accuracy test
Floats = np.ndarray


class Noise(NamedTuple):
    """RMS noise of instruments and environment, in the units of the columns."""

    force: float = BENCH_CHANNELS["force"].noise
    pressure: float = BENCH_CHANNELS["pressure"].noise
    muscle_length: float = BENCH_CHANNELS["muscle_length"].noise
    wander: float = 0.004
    """Slow disturbance of the true pressure [bar]; stays below 0.01 bar."""
    logged_length: float = 0.01
    logged_command: float = 0.002


class Hidden(NamedTuple):
    """Hidden content of a dataset."""

    effects: Sequence[Mapping[str, Any]] = ()
    """Effects of the device."""
    instruments: Sequence[Mapping[str, Any]] = ()
    """Instrument faults, each with its channel."""
    strangers: Sequence[Mapping[str, Any]] = ()
    """Effects that no catalogue contains."""


def draw_wander(rng: np.random.Generator, n_samples: int, rms_bar: float) -> Floats:
    """Return a slow disturbance of the true pressure on the air grid [Pa]: three sines of 0.1 to 0.8 Hz."""
    t = np.arange(n_samples) * AIR_STEP
    frequency, phase = np.exp(rng.uniform(np.log(0.1), np.log(0.8), 3)), rng.uniform(0, 2 * np.pi, 3)
    return rms_bar * 1e5 * np.sqrt(2 / 3) * np.sin(2 * np.pi * frequency[:, None] * t + phase[:, None]).sum(axis=0)


def simulate_trace(
    program: InputProgram,
    law: Law,
    air: AirSupply,
    disturbance: Floats | float = 0.0,
    tolerance: float = LENGTH_TOLERANCE,
) -> dict[str, Floats]:
    """Return the true channels on the trace grid, in the units of the columns."""
    air_steps = round(TRACE_STEP / AIR_STEP)
    n = (len(program.length) - 1) * air_steps + 1
    command, command_step = program.command, SAMPLE_INTERVAL
    if air.regulator_is_upstream != 0.0:
        # No motion changes the pressure before the needle, so it is known in advance.
        command, command_step = simulate_pressure(command, command_step, n, air), AIR_STEP
        air = air._replace(gain=1.0, offset=0.0, dead_time=0.0)
    if is_coupled_to_motion(air):
        # Enclosed air may expand below ambient pressure, so it has no lower limit.
        prescribed_pressure = np.broadcast_to(np.asarray(disturbance, float), n).copy()
    else:
        prescribed_pressure = np.maximum(simulate_pressure(program.command, SAMPLE_INTERVAL, n, air) + disturbance, 0.0)
    inputs = DeviceInputs(program.spline_coefficients(), prescribed_pressure, command, command_step)
    force, length, pressure, _ = integrate_device(inputs, law, air, tolerance)
    if not is_coupled_to_motion(air):
        pressure = prescribed_pressure[::air_steps]
    return {"force": force, "pressure": pressure / 1e5, "muscle_length": length * 1e3}


def simulate_measurements(
    program: InputProgram, base_device: tuple[Law, AirSupply], hidden: Hidden, disturbance: Floats | float = 0.0
) -> dict[str, Floats]:
    """Return the channels of ``base_device`` with the ``hidden`` effects as its instruments report them."""
    true = simulate_trace(
        apply_to_motion(program, hidden.strangers), *add_effects(*base_device, hidden.effects), disturbance
    )
    return apply_faults(apply_to_channels(true, program, hidden.strangers), hidden.instruments)


def apply_faults(channels: Mapping[str, Floats], faults: Sequence[Mapping[str, Any]]) -> dict[str, Floats]:
    """Return the channels as faulty instruments report them on the trace grid, without noise and rounding."""
    out = {name: values.copy() for name, values in channels.items()}
    for fault in faults:
        channel, p = fault["channel"], fault["parameters"]
        if set(p) != set(instrument_forms(channel).get((fault["name"], fault["form"]), {})):
            raise ValueError(f"no instrument fault {fault['name']}/{fault['form']} with {sorted(p)}")
        values = out[channel]
        t = np.arange(len(values)) * TRACE_STEP
        match fault["name"]:
            case "sensor_gain":
                values = p["gain"] * values
            case "sensor_offset":
                values = values + p["offset"]
            case "sensor_drift":
                values = values + p["drift_per_s"] * t
            case "sensor_lag":
                values = _apply_lag(values, p["time_constant_s"])
            case "clock_skew":
                values = np.interp(t - p["shift_s"], t, values)
        out[channel] = values
    return out


def quantise(channel: str, values: Floats, faults: Sequence[Mapping[str, Any]]) -> Floats:
    """Return ``values`` of ``channel`` as a display with coarse steps shows them; ``values`` must include the noise."""
    for fault in faults:
        if fault["name"] == "quantisation" and fault["channel"] == channel and fault["parameters"]["step"] > 0.0:
            step = fault["parameters"]["step"]
            values = step * np.floor(values / step + 0.5)
    return values


def _apply_lag(values: Floats, time_constant: float) -> Floats:
    """Apply a first-order lag, exact for linear interpolation, from rest."""
    if time_constant <= 0.0:
        return values
    ratio = time_constant / TRACE_STEP
    decay = np.exp(-1.0 / ratio)
    new, old = 1.0 - ratio * (1.0 - decay), ratio * (1.0 - decay) - decay
    return lfilter([new, old], [1.0, -decay], values, zi=[values[0] * (1.0 - new)])[0]


def draw_coloured_noise(rng: np.random.Generator, n_samples: int, rms: float) -> Floats:
    """Return AR(1) noise at the sampling rate with a correlation time of 10 to 30 ms."""
    decay = np.exp(-SAMPLE_INTERVAL / rng.uniform(0.010, 0.030))
    white = rng.normal(0.0, rms * np.sqrt(1.0 - decay**2), n_samples)
    start = rng.normal(0.0, rms)
    return lfilter([1.0], [1.0, -decay], white, zi=[decay * start])[0]
