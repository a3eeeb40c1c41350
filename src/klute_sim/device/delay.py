"""Dead time of commands: the only implementation, used by rollouts, replays and rigs.

A device with the effect ``pressure_delay`` or ``hose`` acts on the command of an earlier time.
Between two samples a command is a straight line; before the first sample it equals the first sample.
"""

from collections.abc import Sequence

from klute_sim.types import Array


def interpolate_samples(samples: Sequence[float] | Array, index: float) -> float:
    """Return ``samples`` linearly interpolated at the fractional ``index``; below 0, the first sample."""
    if index <= 0.0:
        return samples[0]
    k = int(index)
    fraction = index - k
    if fraction == 0.0:
        return samples[k]
    return samples[k] + fraction * (samples[k + 1] - samples[k])


class DelayLine:
    """Delay a series of commands, one per time step, by a dead time.

    ``commands`` may be filled while the simulation runs: a sample is read only at or after its own time step.
    """

    def __init__(self, commands: Sequence[float] | Array, dead_time: float, dt: float) -> None:
        """Delay ``commands``, one per time step ``dt`` [s], by ``dead_time`` [s]."""
        self._commands = commands
        self._delay_steps = dead_time / dt

    def sample(self, step: int) -> float:
        """Return the delayed command at time step ``step``."""
        return float(interpolate_samples(self._commands, step - self._delay_steps))
