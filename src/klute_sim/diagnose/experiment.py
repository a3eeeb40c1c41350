"""Measured trials made ready to be simulated, and the device simulated in them.

Prescribed channels are interpolated linearly between their samples, which are rid of noise only where that is safe
(:mod:`klute_sim.diagnose.quiet`): a smooth curve through a quick release is wrong by more than the noise of its
samples.
"""

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from klute_sim.dataset.dataset import Dataset
from klute_sim.dataset.split import Split
from klute_sim.dataset.trial import Series, Trial, Use
from klute_sim.device.files import Device, refuse_openings
from klute_sim.device.rollout import rollout
from klute_sim.device.step import DEAD_TIME, Parameters, settled
from klute_sim.diagnose.quiet import quieter
from klute_sim.effects.catalogue import effects
from klute_sim.units import BAR

Array = NDArray[np.float64]

STEPS_PER_SAMPLE = 10
SHORTEST, LONGEST = 5e-4, 5e-3
"""Time steps [s]: with a shorter one the error is lost in a load cell's noise; a longer one is not needed."""
CLOSEST = 2e-3
"""Between samples of a measured channel [s]: of one that was sampled faster, only every so-manieth is used. Noise stays
alike for longer than this, and a million rows would fill the memory."""
PAST, LONGEST_PAST = 0.1, 0.5
"""Share of a trial, and time [s], that is simulated but not compared: what friction remembers from before the trial
is not known, and is forgotten in the first movements."""
COARSE = 2
"""So many steps in one are good enough for derivatives, within a fifth. What they change is what is wrong with the
single ones, too, and is taken off."""
KEPT = 128
"""Simulations that are remembered."""

UNITS = {"force": ("N", 1.0), "pressure": ("bar", BAR), "muscle_length": ("mm", 1e-3)}
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


class Setting(NamedTuple):
    """A device and the instruments that look at it: all that a simulation of a trial needs."""

    parameters: Parameters
    readings: tuple[Reading, ...] = ()


@dataclass(frozen=True, eq=False)
class Experiment:
    """A trial, its inputs on the simulation's own grid."""

    name: str
    group: str
    use: Use
    device: Device
    begin: float
    """Time of the first sample [s]."""
    step: float
    """Between the inputs below [s]."""
    unit_length: Array
    """[m], one per step."""
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
        return len(self.unit_length) * self.step

    @cached_property
    def coarse(self) -> "Experiment":
        """The same in fewer, longer steps."""
        many = min(COARSE, int(LONGEST / self.step + 1e-6))
        if many < 2:
            return self
        length, command = self.unit_length[many - 1 :: many], self.command[many - 1 :: many]
        return replace(self, step=self.step * many, unit_length=length, command=command)


def prepare(dataset: Dataset, split: Split) -> list[Experiment]:
    """The trials of ``dataset``, in its order; raises InputError for devices that are commanded by openings."""
    for trial in dataset.trials:
        refuse_openings(trial.device, f"trial '{trial.name}'")
    uses: dict[str, Use] = dict.fromkeys(split.fit, "fit")
    uses |= dict.fromkeys(split.select, "select")
    uses |= dict.fromkeys(split.show, "show")
    return [_experiment(trial, uses[trial.name]) for trial in dataset.trials]


def _experiment(trial: Trial, use: Use) -> Experiment:
    length, command = trial.prescribed["length"], trial.prescribed["pressure_command"]
    begin = max(length.time[0], command.time[0])
    end = min(length.time[-1], command.time[-1])
    interval = min(length.interval, command.interval)
    step = interval / max(1, round(interval / min(max(interval / STEPS_PER_SAMPLE, SHORTEST), LONGEST)))
    grid = begin + step * np.arange(1, int((end - begin) / step + 1e-6) + 1)
    measured, first = {}, begin + min(PAST * (end - begin), LONGEST_PAST)
    for name, series in trial.measured.items():
        good = np.isfinite(series.value) & (series.time > first) & (series.time <= grid[-1])
        sampled = Series(series.time[good], series.value[good])
        every = max(1, int(CLOSEST / sampled.interval + 1e-6))
        measured[name] = Series(sampled.time[::every], sampled.value[::every])
    return Experiment(
        name=trial.name,
        group=trial.group,
        use=use,
        device=trial.device,
        begin=begin,
        step=step,
        unit_length=np.interp(grid, length.time, quieter(length.time, length.value)),
        command=np.interp(grid, command.time, quieter(command.time, command.value)),
        measured=measured,
        checked=trial.checked,
    )


class Motion(NamedTuple):
    """What the device does in a trial, after each step."""

    time: Array
    """[s]"""
    tension: Array
    """[N]"""
    pressure: Array
    """Gauge pressure [Pa]."""
    length: Array
    """Muscle length [m]."""


def trace(parameters: Parameters, experiment: Experiment) -> Motion:
    """``experiment`` in its own steps, from rest at its first inputs.

    Steps are put where a delayed command has its corners: a rate that is limited would begin up to a step early.
    """
    length, command, step = experiment.unit_length, experiment.command, experiment.step
    start = settled(parameters, float(length[0]), float(command[0]))
    whole = math.floor(parameters.effects[DEAD_TIME] / step + 1e-9)
    shift = max(0.0, parameters.effects[DEAD_TIME] - whole * step)
    if shift > 0.0:
        late = (*parameters.effects[:DEAD_TIME], whole * step, *parameters.effects[DEAD_TIME + 1 :])
        parameters = parameters._replace(effects=late)
        length = length + shift / step * np.diff(length, append=length[-1])
    found = rollout(parameters, length, command, step, start=start, threads=1)
    time: Array = experiment.begin + shift + step * np.arange(1.0, len(length) + 1.0)
    return Motion(time, found.tension, found.pressure, found.length)


def extrapolated(fine: Motion, coarse: Motion) -> Motion:
    """What shorter and shorter steps tend to (Richardson, 1911), by two of :data:`COARSE` times different length.

    The error of a step is proportional to its length, so what longer ones change is a multiple of it.
    """
    right: list[Array] = []
    for short, long in zip(fine[1:], coarse[1:], strict=True):
        wrong = np.interp(coarse.time, fine.time, short) - long
        right.append(short + np.interp(fine.time, coarse.time, wrong).astype(np.float64) / (COARSE - 1))
    return Motion(fine.time, *right)


def moved(
    parameters: Parameters, experiment: Experiment, by: Callable[[Parameters, Experiment], Motion] = trace
) -> Motion:
    """``experiment`` in steps as short as it needs, simulated ``by`` that."""
    coarse = by(parameters, experiment.coarse)
    return coarse if experiment.coarse is experiment else extrapolated(by(parameters, experiment), coarse)


def shown(setting: Setting, experiment: Experiment, found: Motion) -> dict[str, Array]:
    """What the instruments of ``experiment`` would have shown of ``found``, at the times of their samples."""
    values = {"force": found.tension, "pressure": found.pressure, "muscle_length": found.length}
    result = {}
    for channel, series in experiment.measured.items():
        value = values[channel]
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
        self._kept: dict[tuple[Parameters, Experiment], Motion] = {}
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
        devices = list(dict.fromkeys((s.parameters, e) for s, e in work))
        motions = dict(zip(devices, self._pool.map(lambda one: self._moved(*one, coarse=coarse), devices), strict=True))
        for key in list(self._kept)[:-KEPT]:
            del self._kept[key]
        done = [shown(s, e, motions[s.parameters, e]) for s, e in work]
        width = len(experiments)
        return [done[k : k + width] for k in range(0, len(done), width)]

    def _moved(self, parameters: Parameters, experiment: Experiment, *, coarse: bool) -> Motion:
        return self._traced(parameters, experiment.coarse) if coarse else moved(parameters, experiment, self._traced)

    def _traced(self, parameters: Parameters, experiment: Experiment) -> Motion:
        key = parameters, experiment
        if key not in self._kept:
            self.rollouts += 1
            self._kept[key] = trace(parameters, experiment)
        return self._kept[key]

    def close(self) -> None:
        """Let the threads go; what has not begun is dropped."""
        self._pool.shutdown(wait=True, cancel_futures=True)
