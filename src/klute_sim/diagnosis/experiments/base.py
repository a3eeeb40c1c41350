"""Measured trials made ready to be simulated, on whichever rig, and the device simulated in them.

What a rig prescribes, and how a device moves under it, is its own: ``on_bench`` and ``on_gait``.
"""

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from klute_sim.datasets.trial import Series, Trial, Use
from klute_sim.device.device import Device
from klute_sim.device.dynamics import DeviceParameters
from klute_sim.effects.catalogue import get_effects
from klute_sim.units import BAR

Array = NDArray[np.float64]

MIN_SAMPLING_INTERVAL = 2e-3
"""Between samples of a measured channel [s]: of one that was sampled faster, only every so-manieth is used. Noise stays
alike for longer than this, and a million rows would fill the memory."""
WARM_UP_FRACTION, MAX_WARM_UP_TIME = 0.1, 0.5
"""Share of a trial, and time [s], that is simulated but not compared: what friction remembers from before the trial
is not known, and is forgotten in the first movements."""
COARSE_STEP_FACTOR = 2
"""So many steps in one are good enough for derivatives, within a fifth. What they change is what is wrong with the
single ones, too, and is taken off."""
PRESSURE_PERTURBATION = 2e3
"""By how much a pressure is moved to see what its noise does [Pa]."""
MAX_CACHED_SIMULATIONS = 128
"""Simulations that are remembered."""

CHANNEL_UNITS = {
    **{"force": ("N", 1.0), "pressure": ("bar", BAR), "muscle_length": ("mm", 1e-3)},
    **{"ankle_angle": ("deg", np.pi / 180.0), "ankle_moment": ("N*m", 1.0)},
}
"""Channel -> unit it is shown in, and that unit in SI."""


class SupportsQuantize(Protocol):
    """An instrument that shows whole steps only."""

    def quantize(self, value: Array) -> Array:
        """What is shown on average for ``value`` [SI]."""


class SensorModel(NamedTuple):
    """What a form of an instrument's effect does to a channel."""

    channel: str
    effect: str
    parameters: tuple[float, ...]


class BodyEdit(NamedTuple):
    """A form of an effect of the body, with its parameters by key, in their units."""

    effect: str
    form: str
    parameters: tuple[tuple[str, float], ...]


class SimulationSetup(NamedTuple):
    """A device, the body it is built into and the instruments that look at it: all that a simulation needs."""

    parameters: DeviceParameters
    sensors: tuple[SensorModel, ...] = ()
    body_edits: tuple[BodyEdit, ...] = ()


class DeviceResponse(NamedTuple):
    """What the device does in a trial."""

    time: Array
    """[s]"""
    tension: Array
    """[N]"""
    pressure: Array
    """Gauge pressure [Pa]."""
    length: Array
    """Muscle length [m]."""
    angle: Array | None = None
    """Of the ankle, dorsiflexion positive [rad]; None where there is none."""
    moment: Array | None = None
    """About the ankle, plantarflexor positive [N.m]."""


RESPONSE_FIELDS = {
    **{"force": "tension", "pressure": "pressure", "muscle_length": "length"},
    **{"ankle_angle": "ankle_angle", "ankle_moment": "ankle_moment"},
}
"""Channel -> what of a motion it shows."""


class PrescribedInput(NamedTuple):
    """What a rig makes the device follow."""

    label: str
    """Of an axis in a picture, with its unit."""
    si_factor: float
    """That unit in SI."""
    values: Array
    """[SI], one per step."""
    stationary_rate: float
    """Rate [SI/s] below which it holds still."""
    direction_labels: tuple[str, str, str]
    """What falling, still and rising are called."""


@dataclass(frozen=True, eq=False)
class Experiment(ABC):
    """A trial, its inputs on the simulation's own grid; a rig adds its own."""

    name: str
    group: str
    use: Use
    device: Device
    start_time: float
    """Time of the first sample [s]."""
    dt: float
    """Between the inputs [s]."""
    command: Array
    """[Pa], one per step."""
    measured: Mapping[str, Series]
    """Without the samples that are missing, or outside of what is prescribed."""
    noise_scale: Mapping[str, Array] = field(default_factory=dict)
    """Channel -> how loud noise is at each of its samples, over its usual; left out: as usual everywhere."""

    trusted: frozenset[str] = frozenset()
    """Channels whose instrument is known to be right."""
    quantizers: Mapping[str, SupportsQuantize] = field(default_factory=dict)
    """Channels that show whole steps only."""

    @property
    def duration(self) -> float:
        """[s]"""
        return len(self.command) * self.dt

    @property
    @abstractmethod
    def coarse_variant(self) -> "Experiment":
        """The same in fewer, longer steps."""

    @property
    def preparation_variants(self) -> "tuple[Experiment, ...]":
        """The same, prepared in other ways that are as good; none where nothing measured has to be prepared."""
        return ()

    @property
    @abstractmethod
    def prescribed_input(self) -> PrescribedInput:
        """What is prescribed beside the pressure, for pictures."""

    @property
    @abstractmethod
    def has_body(self) -> bool:
        """Whether effects of the body can show."""

    @property
    @abstractmethod
    def informative_channels(self) -> tuple[str, ...]:
        """Channels of which one at least is needed: without it nothing shows of what pulls."""

    @property
    @abstractmethod
    def length_range(self) -> float:
        """Range of what moves the muscle-tendon unit, as its length [m]."""

    @abstractmethod
    def simulate(self, setup: SimulationSetup) -> DeviceResponse:
        """What the device of ``setting`` does, in its own steps; readings do not matter."""

    @abstractmethod
    def perturb_inputs(self, delay: Callable[[Array], Array]) -> "tuple[Experiment, Experiment, Experiment]":
        """With its pressure, and with what else is prescribed, moved a little, and with a ``later`` command."""

    @abstractmethod
    def compute_covariates(self) -> dict[str, Array]:
        """What a misfit may depend on, at each step."""

    def with_repeats(self, repeats: "Sequence[Experiment]") -> "Experiment":
        """The same, as one of ``repeats``; itself is one of them."""
        return self

    def align_time(self, elapsed: Array) -> Array:
        """Time [s] ``since`` the beginning, as it counts in every repeat of this trial."""
        return elapsed

    def smooth(self, values: Array) -> Array:
        """One per step, averaged over a twentieth of a second."""
        width = max(1, round(0.05 * len(values) / self.duration))
        return np.convolve(values, np.ones(width) / width, mode="same")


def select_samples(trial: Trial, start_time: float, end_time: float, last_time: float) -> dict[str, Series]:
    """The samples of ``trial`` that are compared, if it is simulated from ``begin`` to ``end`` [s].

    Up to the ``last`` step; not missing, not at the beginning, not closer than :data:`CLOSEST`.
    """
    measured, first = {}, start_time + min(WARM_UP_FRACTION * (end_time - start_time), MAX_WARM_UP_TIME)
    for name, series in trial.measured.items():
        good = np.isfinite(series.value) & (series.time > first) & (series.time <= last_time)
        sampled = Series(series.time[good], series.value[good])
        every = max(1, int(MIN_SAMPLING_INTERVAL / sampled.sampling_interval + 1e-6))
        measured[name] = Series(sampled.time[::every], sampled.value[::every])
    return measured


def extrapolate_to_zero_step(fine: DeviceResponse, coarse: DeviceResponse) -> DeviceResponse:
    """What shorter and shorter steps tend to (Richardson, 1911), by two of :data:`COARSE` times different length.

    The error of a step is proportional to its length, so what longer ones change is a multiple of it.
    """
    right: list[Array | None] = []
    for short, long in zip(fine[1:], coarse[1:], strict=True):
        if short is None or long is None:
            right.append(None)
            continue
        wrong = np.interp(coarse.time, fine.time, short) - long
        right.append(short + np.interp(fine.time, coarse.time, wrong).astype(np.float64) / (COARSE_STEP_FACTOR - 1))
    tension, pressure, length, angle, moment = right
    assert tension is not None
    assert pressure is not None
    assert length is not None
    return DeviceResponse(fine.time, tension, pressure, length, angle, moment)


def simulate_once(setup: SimulationSetup, experiment: Experiment) -> DeviceResponse:
    """``experiment`` in its own steps."""
    return experiment.simulate(setup)


def simulate_extrapolated(
    setup: SimulationSetup,
    experiment: Experiment,
    simulator: Callable[[SimulationSetup, Experiment], DeviceResponse] = simulate_once,
) -> DeviceResponse:
    """``experiment`` in steps as short as it needs, simulated ``by`` that."""
    coarse = simulator(setup, experiment.coarse_variant)
    return (
        coarse
        if experiment.coarse_variant is experiment
        else extrapolate_to_zero_step(simulator(setup, experiment), coarse)
    )


def observe(setup: SimulationSetup, experiment: Experiment, response: DeviceResponse) -> dict[str, Array]:
    """What the instruments of ``experiment`` would have shown of ``found``, at the times of their samples."""
    result = {}
    for channel, series in experiment.measured.items():
        value: Array = getattr(response, RESPONSE_FIELDS[channel])
        for reading in setup.sensors:
            if reading.channel == channel:
                value = get_effects()[reading.effect].forms[0].laws["reading"](reading.parameters, response.time, value)
        sampled = np.interp(series.time, response.time, value)
        result[channel] = (
            experiment.quantizers[channel].quantize(sampled) if channel in experiment.quantizers else sampled
        )
    return result


class Simulator:
    """Simulates many settings in many experiments on all cores; the result does not depend on how many."""

    def __init__(self, n_jobs: int = 0) -> None:
        """On ``jobs`` threads (0: all cores)."""
        self._pool = ThreadPoolExecutor(n_jobs or os.cpu_count() or 1)
        self._cache: dict[tuple[SimulationSetup, Experiment], DeviceResponse] = {}
        self.n_rollouts = 0
        """Simulations so far."""

    def simulate(
        self, setups: Sequence[Sequence[SimulationSetup]], experiments: Sequence[Experiment], *, coarse: bool = False
    ) -> list[list[dict[str, Array]]]:
        """For each row of ``settings`` (one per experiment) what the instruments would have shown in each.

        ``coarse``: in long steps, with their error.
        """
        work = [(s, e) for row in setups for s, e in zip(row, experiments, strict=True)]
        # Instruments that look at the same device look at the same simulation.
        devices = list(dict.fromkeys((s._replace(sensors=()), e) for s, e in work))
        motions = dict(
            zip(devices, self._pool.map(lambda one: self._simulate_one(*one, coarse=coarse), devices), strict=True)
        )
        for key in list(self._cache)[:-MAX_CACHED_SIMULATIONS]:
            del self._cache[key]
        done = [observe(s, e, motions[s._replace(sensors=()), e]) for s, e in work]
        width = len(experiments)
        return [done[k : k + width] for k in range(0, len(done), width)]

    def _simulate_one(self, setup: SimulationSetup, experiment: Experiment, *, coarse: bool) -> DeviceResponse:
        return (
            self._simulate_cached(setup, experiment.coarse_variant)
            if coarse
            else simulate_extrapolated(setup, experiment, self._simulate_cached)
        )

    def _simulate_cached(self, setup: SimulationSetup, experiment: Experiment) -> DeviceResponse:
        key = setup, experiment
        if key not in self._cache:
            self.n_rollouts += 1
            self._cache[key] = experiment.simulate(setup)
        return self._cache[key]

    def close(self) -> None:
        """Let the threads go; what has not begun is dropped."""
        self._pool.shutdown(wait=True, cancel_futures=True)
