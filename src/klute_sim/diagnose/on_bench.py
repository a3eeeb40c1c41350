"""Trials of a tensile tester: the length of the whole muscle-tendon unit is prescribed.

Prescribed channels are interpolated linearly between their samples, which are rid of noise only where that is safe
(:mod:`klute_sim.diagnose.quiet`): a smooth curve through a quick release is wrong by more than the noise of its
samples.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from klute_sim.dataset.trial import Trial, Use
from klute_sim.device.rollout import rollout
from klute_sim.device.step import DEAD_TIME, settled
from klute_sim.diagnose.experiment import COARSE, PRESSURE, Array, Course, Experiment, Motion, Setting, compared
from klute_sim.diagnose.quiet import quieter

STEPS_PER_SAMPLE = 10
SHORTEST, LONGEST = 5e-4, 5e-3
"""Time steps [s]: with a shorter one the error is lost in a load cell's noise; a longer one is not needed."""
LENGTH = -1e-4
"""By how much the length is moved to see what its noise does [m]: towards where a bare muscle can go."""

SLOW = 1e-3
"""Speed [m/s] below which the rig holds still."""


@dataclass(frozen=True, eq=False)
class OnBench(Experiment):
    """A trial of the bench."""

    unit_length: Array = field(kw_only=True)
    """[m], one per step."""

    @cached_property
    def coarse(self) -> Experiment:
        """See :class:`Experiment`."""
        many = min(COARSE, int(LONGEST / self.step + 1e-6))
        if many < 2:
            return self
        length, command = self.unit_length[many - 1 :: many], self.command[many - 1 :: many]
        return replace(self, step=self.step * many, unit_length=length, command=command)

    @property
    def course(self) -> Course:
        """See :class:`Experiment`."""
        motions = ("shortening", "still", "lengthening")
        return Course("prescribed length [mm]", 1e-3, self.unit_length, SLOW, motions)

    @property
    def embodied(self) -> bool:
        """See :class:`Experiment`: the device alone is on the bench."""
        return False

    @property
    def telling(self) -> tuple[str, ...]:
        """See :class:`Experiment`."""
        return "force", "muscle_length"

    @property
    def travel(self) -> float:
        """See :class:`Experiment`."""
        return float(np.ptp(self.unit_length))

    def trace(self, setting: Setting) -> Motion:
        """From rest at its first inputs, after each step.

        Steps are put where a delayed command has its corners: a rate that is limited would begin up to a step early.
        """
        parameters, length, command, step = setting.parameters, self.unit_length, self.command, self.step
        start = settled(parameters, float(length[0]), float(command[0]))
        whole = math.floor(parameters.effects[DEAD_TIME] / step + 1e-9)
        shift = max(0.0, parameters.effects[DEAD_TIME] - whole * step)
        if shift > 0.0:
            late = (*parameters.effects[:DEAD_TIME], whole * step, *parameters.effects[DEAD_TIME + 1 :])
            parameters = parameters._replace(effects=late)
            length = length + shift / step * np.diff(length, append=length[-1])
        found = rollout(parameters, length, command, step, start=start, threads=1)
        time: Array = self.begin + shift + step * np.arange(1.0, len(length) + 1.0)
        return Motion(time, found.tension, found.pressure, found.length)

    def swayed(self, later: Callable[[Array], Array]) -> tuple[Experiment, Experiment, Experiment]:
        """See :class:`Experiment`; what else is prescribed is the length."""
        return (
            replace(self, command=self.command + PRESSURE),
            replace(self, unit_length=self.unit_length + LENGTH),
            replace(self, command=later(self.command)),
        )

    def circumstances(self) -> dict[str, Array]:
        """See :class:`Experiment`."""
        speed = np.gradient(self.unit_length, self.duration / len(self.command))
        rate = np.gradient(self.command, self.duration / len(self.command))
        return {
            "pressure": self.command,
            "length": self.unit_length,
            "speed": self.smooth(speed),
            "pressure change": self.smooth(np.abs(rate)),
            "time": np.linspace(0.0, self.duration, len(self.command)),
        }


def on_bench(trial: Trial, use: Use) -> OnBench:
    """``trial`` made ready."""
    length, command = trial.prescribed["length"], trial.prescribed["pressure_command"]
    begin = max(length.time[0], command.time[0])
    end = min(length.time[-1], command.time[-1])
    interval = min(length.interval, command.interval)
    step = interval / max(1, round(interval / min(max(interval / STEPS_PER_SAMPLE, SHORTEST), LONGEST)))
    grid = begin + step * np.arange(1, int((end - begin) / step + 1e-6) + 1)
    return OnBench(
        name=trial.name,
        group=trial.group,
        use=use,
        device=trial.device,
        begin=begin,
        step=step,
        unit_length=np.interp(grid, length.time, quieter(length.time, length.value)),
        command=np.interp(grid, command.time, quieter(command.time, command.value)),
        measured=compared(trial, begin, end, grid[-1]),
        checked=trial.checked,
    )
