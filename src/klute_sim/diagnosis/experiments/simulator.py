"""Simulation of experiments: one run, Richardson extrapolation in the time step, and many runs in parallel."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from klute_sim.diagnosis.experiments.base import (
    DeviceResponse,
    Experiment,
    SimulationSetup,
    censor_reading,
)
from klute_sim.diagnosis.experiments.time_step import COARSE_STEP_FACTOR
from klute_sim.effects.catalogue import find_form
from klute_sim.errors import SimulationError
from klute_sim.types import Array

MAX_CACHED_SIMULATIONS = 128
"""Simulations kept in memory."""


def extrapolate_to_zero_step(fine: DeviceResponse, coarse: DeviceResponse) -> DeviceResponse:
    """Return the limit for a vanishing time step (Richardson, 1911).

    The time step of ``coarse`` is :data:`COARSE_STEP_FACTOR` times that of ``fine``. The error is proportional to the
    time step, so it is a multiple of the difference between the two responses.
    """

    def extrapolate(fine_values: Array, coarse_values: Array) -> Array:
        difference = np.interp(coarse.time, fine.time, fine_values) - coarse_values
        return fine_values + np.interp(fine.time, coarse.time, difference).astype(np.float64) / (COARSE_STEP_FACTOR - 1)

    def extrapolate_optional(fine_values: Array | None, coarse_values: Array | None) -> Array | None:
        return None if fine_values is None or coarse_values is None else extrapolate(fine_values, coarse_values)

    channels = None
    if fine.channels is not None and coarse.channels is not None:
        channels = {name: extrapolate(values, coarse.channels[name]) for name, values in fine.channels.items()}
    return DeviceResponse(
        fine.time,
        extrapolate(fine.tension, coarse.tension),
        extrapolate(fine.pressure, coarse.pressure),
        extrapolate(fine.muscle_length, coarse.muscle_length),
        extrapolate_optional(fine.ankle_angle, coarse.ankle_angle),
        extrapolate_optional(fine.ankle_moment, coarse.ankle_moment),
        channels,
    )


def simulate_once(setup: SimulationSetup, experiment: Experiment) -> DeviceResponse:
    """Simulate ``experiment`` at its own time step."""
    return experiment.simulate(setup)


def simulate_extrapolated(
    setup: SimulationSetup,
    experiment: Experiment,
    simulate: Callable[[SimulationSetup, Experiment], DeviceResponse] = simulate_once,
) -> DeviceResponse:
    """Simulate ``experiment`` and extrapolate to a vanishing time step, where its time step is not long already.

    ``simulate`` runs one simulation.
    """
    variant = experiment.select_variant(setup)
    fine = simulate(setup, variant)
    if not variant.is_extrapolated(setup):
        return fine
    return extrapolate_to_zero_step(fine, simulate(setup, variant.coarse_variant))


def observe(setup: SimulationSetup, experiment: Experiment, response: DeviceResponse) -> dict[str, Array]:
    """Return the sensor readings [SI] of ``response`` per measured channel, at the times of the measured samples."""
    readings = {}
    for channel, series in experiment.measured.items():
        value = response.read_channel(channel)
        for sensor in setup.sensors:
            if sensor.channel == channel:
                _, form = find_form(sensor.effect, sensor.form)
                value = form.laws["reading"](form.parameter_type(*sensor.parameters), response.time, value)
        if channel in experiment.filters:
            value = experiment.filters[channel].apply(response.time, value)
        samples = np.interp(series.time, response.time, value)
        quantizer = experiment.quantizers.get(channel)
        reading = samples if quantizer is None else quantizer.quantize(samples)
        limits = experiment.limits.get(channel)
        readings[channel] = reading if limits is None else censor_reading(reading, series.value, limits)
    return readings


def _make_infinite_readings(experiment: Experiment) -> dict[str, Array]:
    return {channel: np.full(len(series.time), np.inf) for channel, series in experiment.measured.items()}


class Simulator:
    """Simulates many setups in many experiments on a thread pool; results do not depend on the number of threads."""

    def __init__(self, n_jobs: int = 0) -> None:
        """Start ``n_jobs`` threads (0: one per core)."""
        self._pool = ThreadPoolExecutor(n_jobs or os.cpu_count() or 1)
        self._cache: dict[tuple[SimulationSetup, Experiment], DeviceResponse] = {}
        self.n_rollouts = 0
        """Simulations run so far."""

    def simulate(
        self,
        setups: Sequence[Sequence[SimulationSetup]],
        experiments: Sequence[Experiment],
        *,
        coarse: bool = False,
        may_diverge: bool = False,
    ) -> list[list[dict[str, Array]]]:
        """Return the sensor readings for each row of ``setups``, which holds one setup per experiment.

        ``coarse`` simulations use the longer time step and are not extrapolated. A simulation that diverges raises
        SimulationError; with ``may_diverge`` its readings are infinite, so that no fit accepts its setup.
        """

        def simulate(key: tuple[SimulationSetup, Experiment]) -> DeviceResponse | None:
            try:
                return self._simulate_one(*key, coarse=coarse)
            except SimulationError:
                if may_diverge:
                    return None
                raise

        runs = [(s, e) for row in setups for s, e in zip(row, experiments, strict=True)]
        # Setups that differ only in their sensors share one simulation.
        keys = list(dict.fromkeys((s._replace(sensors=()), e) for s, e in runs))
        responses = dict(zip(keys, self._pool.map(simulate, keys), strict=True))
        for key in list(self._cache)[:-MAX_CACHED_SIMULATIONS]:
            del self._cache[key]
        readings = (
            _make_infinite_readings(e) if response is None else observe(s, e, response)
            for s, e in runs
            for response in (responses[s._replace(sensors=()), e],)
        )
        return [[next(readings) for _ in row] for row in setups]

    def compute_nominal_residuals(self, experiments: Sequence[Experiment]) -> list[dict[str, Array]]:
        """Return for each experiment: channel -> measured minus simulated reading [SI] of the device as declared."""
        setups = [SimulationSetup(e.device.parameters) for e in experiments]
        return [
            {channel: series.value - reading[channel] for channel, series in e.measured.items()}
            for e, reading in zip(experiments, self.simulate([setups], experiments)[0], strict=True)
        ]

    def _simulate_one(self, setup: SimulationSetup, experiment: Experiment, *, coarse: bool) -> DeviceResponse:
        if coarse:
            return self._simulate_cached(setup, experiment.select_variant(setup).coarse_variant)
        return simulate_extrapolated(setup, experiment, self._simulate_cached)

    def _simulate_cached(self, setup: SimulationSetup, experiment: Experiment) -> DeviceResponse:
        key = setup, experiment
        if key not in self._cache:
            self.n_rollouts += 1
            self._cache[key] = experiment.simulate(setup)
        return self._cache[key]

    def close(self) -> None:
        """Stop the threads and drop the simulations that have not started."""
        self._pool.shutdown(wait=True, cancel_futures=True)
