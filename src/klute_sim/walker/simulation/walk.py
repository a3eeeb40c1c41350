"""Let a walker walk: steps, commands and a push, until the time is over or the walker falls."""

from collections.abc import Callable
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
        self, simulator: WalkSimulator, commands: DeviceCommands, push: Push | None = None, record: Array | None = None
    ) -> None:
        """Continue from the state of ``simulator``; ``record`` receives one row per step."""
        self._simulator, self._commands, self._push = simulator, commands, push
        self._record, self._n_done, self._push_end = record, 0, -1.0
        self._has_pushed, self._previous_phase = False, 1.0

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
        """Return the force of the push now [N]."""
        push, state, time = self._push, self._simulator.state, self._simulator.time
        if push is None:
            return 0.0
        phase = min(float(state[layout.PHASE_TIME] / state[layout.STRIDE_TIME]), 1.0)
        if not self._has_pushed and time >= push.after and self._previous_phase <= push.phase <= phase:
            self._has_pushed, self._push_end = True, time + PUSH_DURATION - 1e-9
        self._previous_phase = phase if phase >= self._previous_phase else 0.0
        return push.impulse / PUSH_DURATION if time < self._push_end else 0.0
