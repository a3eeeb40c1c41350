"""Let a walker walk: steps, commands and pushes, until the time is over or the walker falls."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from klute_sim.errors import InputError
from klute_sim.types import Array
from klute_sim.walker.simulation import state as layout
from klute_sim.walker.simulation.commands import DeviceCommands
from klute_sim.walker.simulation.simulator import WalkSimulator

PUSH_DURATION = 0.1
"""Duration of a push [s]."""
MAX_IMPULSE = 100.0
"""Largest impulse of a push [N*s]."""


@dataclass(frozen=True, kw_only=True)
class Push:
    """A horizontal push on the hip; validated when made."""

    impulse: float
    """Impulse [N*s], forward positive."""
    phase: float = 0.0
    """Estimated phase of the right leg's stride at which it begins (0-1)."""
    after: float = 5.0
    """Time before which it does not begin [s]."""

    def __post_init__(self) -> None:
        """Raise InputError when a number is out of range."""
        if not abs(self.impulse) <= MAX_IMPULSE:
            raise InputError(f"push is {self.impulse:g}; allowed: -{MAX_IMPULSE:g} to {MAX_IMPULSE:g} N·s")
        if not 0.0 <= self.phase < 1.0:
            raise InputError(f"phase of the push is {100 * self.phase:g}; allowed: 0 to below 100 % of the stride")
        if not self.after >= 0.0:
            raise InputError(f"time of the push is {self.after:g}; allowed: 0 s or more")


class Walk:
    """A walk that is under way; every call of :meth:`advance` continues it."""

    def __init__(
        self,
        simulator: WalkSimulator,
        commands: DeviceCommands,
        pushes: Sequence[Push] = (),
        record: Array | None = None,
    ) -> None:
        """Continue from the state of ``simulator``; ``record`` receives one row per step."""
        self._simulator, self._commands = simulator, commands
        self._record, self._n_done = record, 0
        self._later_pushes = sorted(pushes, key=lambda push: push.after)
        self._push_force, self._push_end, self._previous_phase = 0.0, -1.0, 1.0

    def advance(self, seconds: float, progress: Callable[[float], None] = lambda fraction: None) -> bool:
        """Walk for ``seconds`` more; return whether the walker still walks at their end."""
        n_steps = round(seconds / self._simulator.settings.dt)
        n_taken = 0
        while n_taken < n_steps:
            self._commands.update(self._n_done)
            n = min(self._commands.steps_per_update, n_steps - n_taken)
            rows = None if self._record is None else self._record[self._n_done : self._n_done + n]
            n_walked = self._simulator.take_steps(n, push=self._compute_push(), record=rows)
            self._n_done += n_walked
            n_taken += n_walked
            if n_walked < n:
                return False
            if n_taken % 1000 < n:
                progress(n_taken / n_steps)
        return not self._simulator.has_fallen()

    @property
    def n_steps(self) -> int:
        """Number of steps taken."""
        return self._n_done

    def _compute_push(self) -> float:
        """Return the force on the hip now [N]; pushes follow each other in the order of their times."""
        state, time = self._simulator.state, self._simulator.time
        phase = min(float(state[layout.PHASE_TIME] / state[layout.STRIDE_TIME]), 1.0)
        if self._later_pushes and time >= self._push_end:
            push = self._later_pushes[0]
            if time >= push.after and self._previous_phase <= push.phase <= phase:
                self._later_pushes.pop(0)
                self._push_force, self._push_end = push.impulse / PUSH_DURATION, time + PUSH_DURATION - 1e-9
        self._previous_phase = phase if phase >= self._previous_phase else 0.0
        return self._push_force if time < self._push_end else 0.0
