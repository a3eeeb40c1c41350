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

from klute_sim.dataset.trial import Series, Trial, Use
from klute_sim.device.files import Device
from klute_sim.device.step import Parameters
from klute_sim.effects.catalogue import effects
from klute_sim.units import BAR

Array = NDArray[np.float64]

CLOSEST = 2e-3
"""Between samples of a measured channel [s]: of one that was sampled faster, only every so-manieth is used. Noise stays
alike for longer than this, and a million rows would fill the memory."""
PAST, LONGEST_PAST = 0.1, 0.5
"""Share of a trial, and time [s], that is simulated but not compared: what friction remembers from before the trial
is not known, and is forgotten in the first movements."""
COARSE = 2
"""So many steps in one are good enough for derivatives, within a fifth. What they change is what is wrong with the
single ones, too, and is taken off."""
PRESSURE = 2e3
"""By how much a pressure is moved to see what its noise does [Pa]."""
KEPT = 128
"""Simulations that are remembered."""

UNITS = {
    **{"force": ("N", 1.0), "pressure": ("bar", BAR), "muscle_length": ("mm", 1e-3)},
    **{"ankle_angle": ("deg", np.pi / 180.0), "ankle_moment": ("N*m", 1.0)},
}
"""Channel -> unit it is shown in, and that unit in SI."""


class Display(Protocol):
    """An instrument that shows whole steps only."""

    def shows(self, value: Array) -> Array:
        """What is shown on average for ``value`` [SI]."""


class Reading(NamedTuple):
    """What a form of an instrument's effect does to a channel."""

    channel: str
    effect: str
    own: tuple[float, ...]


class Edit(NamedTuple):
    """A form of an effect of the body, with its parameters by key, in their units."""

    effect: str
    form: str
    own: tuple[tuple[str, float], ...]


class Setting(NamedTuple):
    """A device, the body it is built into and the instruments that look at it: all that a simulation needs."""

    parameters: Parameters
    readings: tuple[Reading, ...] = ()
    body: tuple[Edit, ...] = ()


class Motion(NamedTuple):
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


SHOWS = {
    **{"force": "tension", "pressure": "pressure", "muscle_length": "length"},
    **{"ankle_angle": "angle", "ankle_moment": "moment"},
}
"""Channel -> what of a motion it shows."""


class Course(NamedTuple):
    """What a rig makes the device follow."""

    label: str
    """Of an axis in a picture, with its unit."""
    si: float
    """That unit in SI."""
    values: Array
    """[SI], one per step."""
    slow: float
    """Rate [SI/s] below which it holds still."""
    motions: tuple[str, str, str]
    """What falling, still and rising are called."""


@dataclass(frozen=True, eq=False)
class Experiment(ABC):
    """A trial, its inputs on the simulation's own grid; a rig adds its own."""

    name: str
    group: str
    use: Use
    device: Device
    begin: float
    """Time of the first sample [s]."""
    step: float
    """Between the inputs [s]."""
    command: Array
    """[Pa], one per step."""
    measured: Mapping[str, Series]
    """Without the samples that are missing, or outside of what is prescribed."""
    loud: Mapping[str, Array] = field(default_factory=dict)
    """Channel -> how loud noise is at each of its samples, over its usual; left out: as usual everywhere."""

    checked: frozenset[str] = frozenset()
    """Channels whose instrument is known to be right."""
    displays: Mapping[str, Display] = field(default_factory=dict)
    """Channels that show whole steps only."""

    @property
    def duration(self) -> float:
        """[s]"""
        return len(self.command) * self.step

    @property
    @abstractmethod
    def coarse(self) -> "Experiment":
        """The same in fewer, longer steps."""

    @property
    def otherwise(self) -> "tuple[Experiment, ...]":
        """The same, prepared in other ways that are as good; none where nothing measured has to be prepared."""
        return ()

    @property
    @abstractmethod
    def course(self) -> Course:
        """What is prescribed beside the pressure, for pictures."""

    @property
    @abstractmethod
    def embodied(self) -> bool:
        """Whether effects of the body can show."""

    @property
    @abstractmethod
    def telling(self) -> tuple[str, ...]:
        """Channels of which one at least is needed: without it nothing shows of what pulls."""

    @property
    @abstractmethod
    def travel(self) -> float:
        """Range of what moves the muscle-tendon unit, as its length [m]."""

    @abstractmethod
    def trace(self, setting: Setting) -> Motion:
        """What the device of ``setting`` does, in its own steps; readings do not matter."""

    @abstractmethod
    def swayed(self, later: Callable[[Array], Array]) -> "tuple[Experiment, Experiment, Experiment]":
        """With its pressure, and with what else is prescribed, moved a little, and with a ``later`` command."""

    @abstractmethod
    def circumstances(self) -> dict[str, Array]:
        """What a misfit may depend on, at each step."""

    def beside(self, repeats: "Sequence[Experiment]") -> "Experiment":
        """The same, as one of ``repeats``; itself is one of them."""
        return self

    def clock(self, since: Array) -> Array:
        """Time [s] ``since`` the beginning, as it counts in every repeat of this trial."""
        return since

    def smooth(self, values: Array) -> Array:
        """One per step, averaged over a twentieth of a second."""
        width = max(1, round(0.05 * len(values) / self.duration))
        return np.convolve(values, np.ones(width) / width, mode="same")


def compared(trial: Trial, begin: float, end: float, last: float) -> dict[str, Series]:
    """The samples of ``trial`` that are compared, if it is simulated from ``begin`` to ``end`` [s].

    Up to the ``last`` step; not missing, not at the beginning, not closer than :data:`CLOSEST`.
    """
    measured, first = {}, begin + min(PAST * (end - begin), LONGEST_PAST)
    for name, series in trial.measured.items():
        good = np.isfinite(series.value) & (series.time > first) & (series.time <= last)
        sampled = Series(series.time[good], series.value[good])
        every = max(1, int(CLOSEST / sampled.interval + 1e-6))
        measured[name] = Series(sampled.time[::every], sampled.value[::every])
    return measured


def extrapolated(fine: Motion, coarse: Motion) -> Motion:
    """What shorter and shorter steps tend to (Richardson, 1911), by two of :data:`COARSE` times different length.

    The error of a step is proportional to its length, so what longer ones change is a multiple of it.
    """
    right: list[Array | None] = []
    for short, long in zip(fine[1:], coarse[1:], strict=True):
        if short is None or long is None:
            right.append(None)
            continue
        wrong = np.interp(coarse.time, fine.time, short) - long
        right.append(short + np.interp(fine.time, coarse.time, wrong).astype(np.float64) / (COARSE - 1))
    tension, pressure, length, angle, moment = right
    assert tension is not None
    assert pressure is not None
    assert length is not None
    return Motion(fine.time, tension, pressure, length, angle, moment)


def traced(setting: Setting, experiment: Experiment) -> Motion:
    """``experiment`` in its own steps."""
    return experiment.trace(setting)


def moved(setting: Setting, experiment: Experiment, by: Callable[[Setting, Experiment], Motion] = traced) -> Motion:
    """``experiment`` in steps as short as it needs, simulated ``by`` that."""
    coarse = by(setting, experiment.coarse)
    return coarse if experiment.coarse is experiment else extrapolated(by(setting, experiment), coarse)


def shown(setting: Setting, experiment: Experiment, found: Motion) -> dict[str, Array]:
    """What the instruments of ``experiment`` would have shown of ``found``, at the times of their samples."""
    result = {}
    for channel, series in experiment.measured.items():
        value: Array = getattr(found, SHOWS[channel])
        for reading in setting.readings:
            if reading.channel == channel:
                value = effects()[reading.effect].forms[0].laws["reading"](reading.own, found.time, value)
        sampled = np.interp(series.time, found.time, value)
        result[channel] = experiment.displays[channel].shows(sampled) if channel in experiment.displays else sampled
    return result


class Bench:
    """Simulates many settings in many experiments on all cores; the result does not depend on how many."""

    def __init__(self, jobs: int = 0) -> None:
        """On ``jobs`` threads (0: all cores)."""
        self._pool = ThreadPoolExecutor(jobs or os.cpu_count() or 1)
        self._kept: dict[tuple[Setting, Experiment], Motion] = {}
        self.rollouts = 0
        """Simulations so far."""

    def simulate(
        self, settings: Sequence[Sequence[Setting]], experiments: Sequence[Experiment], *, coarse: bool = False
    ) -> list[list[dict[str, Array]]]:
        """For each row of ``settings`` (one per experiment) what the instruments would have shown in each.

        ``coarse``: in long steps, with their error.
        """
        work = [(s, e) for row in settings for s, e in zip(row, experiments, strict=True)]
        # Instruments that look at the same device look at the same simulation.
        devices = list(dict.fromkeys((s._replace(readings=()), e) for s, e in work))
        motions = dict(zip(devices, self._pool.map(lambda one: self._moved(*one, coarse=coarse), devices), strict=True))
        for key in list(self._kept)[:-KEPT]:
            del self._kept[key]
        done = [shown(s, e, motions[s._replace(readings=()), e]) for s, e in work]
        width = len(experiments)
        return [done[k : k + width] for k in range(0, len(done), width)]

    def _moved(self, setting: Setting, experiment: Experiment, *, coarse: bool) -> Motion:
        return self._traced(setting, experiment.coarse) if coarse else moved(setting, experiment, self._traced)

    def _traced(self, setting: Setting, experiment: Experiment) -> Motion:
        key = setting, experiment
        if key not in self._kept:
            self.rollouts += 1
            self._kept[key] = experiment.trace(setting)
        return self._kept[key]

    def close(self) -> None:
        """Let the threads go; what has not begun is dropped."""
        self._pool.shutdown(wait=True, cancel_futures=True)
