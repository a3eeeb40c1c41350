"""Walks of a replay with invented motion and load: fast, with known effects, for tests of the diagnosis of gait."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from klute_sim.datasets.trial import TimeSeries
from klute_sim.device.device import load_device, parse_device
from klute_sim.diagnosis.experiments.base import BodyEdit
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.experiments.registration import PlateLoad
from klute_sim.diagnosis.experiments.simulator import Simulator, simulate_extrapolated
from klute_sim.diagnosis.fitting.hypothesis import Hypothesis
from klute_sim.diagnosis.fitting.weighted_data import WeightedData
from klute_sim.diagnosis.noise.repeats import estimate_noise_from_repeats
from klute_sim.gait.replay.foot import build_device_foot
from klute_sim.gait.replay.rollout import ReplayInputs
from klute_sim.types import Array

DEVICE = load_device("klute-1-1-4-pair")
FOOT = build_device_foot(DEVICE)
STEP, STRIDE_TIME, N_STRIDES = 1e-3, 1.1, 4
NOISE = {"ankle_angle": np.radians(0.1), "force": 5.0, "pressure": 1e3, "muscle_length": 5e-5}
INTERVALS = {"ankle_angle": 5e-3, "force": 2e-3, "pressure": 2e-3, "muscle_length": 2e-3}
MOMENT_NOISE = 0.5
"""Noise of the ground reaction's moment about the ankle [N.m]."""


def compute_inputs(amplitude: float) -> ReplayInputs:
    """Return inputs with ``amplitude`` times the load of a person of 75 kg."""
    time = STEP * np.arange(round(N_STRIDES * STRIDE_TIME / STEP), dtype=np.float64)
    phase = (time / STRIDE_TIME) % 1.0
    stance = np.where(phase < 0.6, np.sin(np.pi * phase / 0.6), 0.0)
    late = np.where(phase < 0.6, np.sin(np.pi * (phase / 0.6) ** 2), 0.0)
    shank, rate = 0.35 * np.sin(2.0 * np.pi * (phase - 0.3)), 2.0 * np.pi / STRIDE_TIME
    return ReplayInputs(
        shank_angle=shank,
        shank_angular_acceleration=-(rate**2) * shank,
        ankle_acceleration_x=3.0 * np.cos(2.0 * np.pi * phase),
        ankle_acceleration_z=2.0 * np.sin(2.0 * np.pi * phase),
        ground_moment=amplitude * (8.0 * stance**2 - 85.0 * late**2),
        axial_force=800.0 * amplitude * stance,
        shear_force=120.0 * amplitude * stance * np.sin(2.0 * np.pi * phase),
        pressure_command=1e5 * (1.0 + 2.0 * late**2),
    )


def make_walks(
    *,
    effects: str = "",
    body_edits: Sequence[BodyEdit] = (),
    moment: Array | float = 0.0,
    amplitudes: Sequence[float] = (1.0, 0.7),
    seed: int = 0,
) -> list[GaitExperiment]:
    """Return two repeats at each of ``amplitudes`` of the load.

    ``effects`` are sections of the device file of the truth, ``body_edits`` its effects of the body, and ``moment``
    [N.m] acts about its ankle in addition.
    """
    rng = np.random.default_rng(seed)
    truth = parse_device((DEVICE.content.decode() + effects).encode(), DEVICE.name)
    walks = []
    for group, amplitude in enumerate(amplitudes):
        inputs = compute_inputs(amplitude)
        for repeat in range(2):
            walk = GaitExperiment(
                name=f"{group}_{repeat}",
                group=str(group),
                use="fit",
                device=DEVICE,
                start_time=0.0,
                dt=STEP,
                command=inputs.pressure_command,
                measured={},
                foot=FOOT,
                inputs=inputs._replace(ground_moment=inputs.ground_moment + moment),
                smoothed_inputs=inputs,
                load=PlateLoad(
                    inputs.axial_force, np.zeros_like(inputs.axial_force), np.zeros_like(inputs.axial_force)
                ),
                foot_strikes=STRIDE_TIME * np.arange(N_STRIDES, dtype=np.float64),
                alignment=0.0,
                mean_stride_time=STRIDE_TIME,
            )
            (setup,) = Hypothesis(truth, (), ()).build_setups(np.zeros(0), [replace(walk, device=truth)])
            response = simulate_extrapolated(setup._replace(body_edits=tuple(body_edits)), walk)
            measured = {}
            for channel, noise in NOISE.items():
                time = np.arange(0.5, response.time[-1], INTERVALS[channel])
                value = np.interp(time, response.time, response.read_channel(channel))
                measured[channel] = TimeSeries(time, value + noise * rng.normal(size=len(time)))
            noisy = inputs.ground_moment + MOMENT_NOISE * rng.normal(size=len(inputs.ground_moment))
            walks.append(replace(walk, measured=measured, inputs=inputs._replace(ground_moment=noisy)))
    return walks


def weight_walks(walks: Sequence[GaitExperiment], simulator: Simulator) -> tuple[WeightedData, Hypothesis]:
    """Return ``walks`` weighted by the noise between their repeats, and the device without uncertain numbers."""
    nominal = Hypothesis(DEVICE, (), tuple(NOISE.items()))
    unweighted = WeightedData(simulator, walks, {})
    (residuals,) = unweighted.compute_residuals(nominal, [np.zeros(0)])
    return WeightedData(simulator, walks, estimate_noise_from_repeats(walks, residuals)), nominal
