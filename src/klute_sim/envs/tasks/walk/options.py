"""Options of the walking task besides the prosthesis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from klute_sim.controllers.parse import Controller
from klute_sim.controllers.pressure import PressureController
from klute_sim.device.device import check_accepts_pressure
from klute_sim.envs.base.task import CONTROL_INTERVAL
from klute_sim.envs.tasks.options import check_action_limits
from klute_sim.envs.tasks.reward import resolve_weights
from klute_sim.envs.tasks.walk.reward import DEFAULT_WEIGHTS
from klute_sim.errors import InputError
from klute_sim.walker.person.build import MAX_DT, MAX_UNEVENNESS, Prosthesis

WALK_ACTION_KINDS = ("pressure", "residual")
"""Kinds of actions: the gauge pressure, or a change of that of a base controller."""
MAX_DURATION = 200.0
"""Longest episode [s]."""
MAX_GAIN_NOISE = 0.2
"""Largest relative standard deviation of the gains."""
N_GROUNDS = 16
"""Number of random grounds from which an episode on uneven ground samples one; each is built once."""


@dataclass(frozen=True, kw_only=True)
class WalkTaskOptions:
    """Options of the walking task, validated at construction."""

    prosthesis: Prosthesis
    """Prosthesis; on a spring foot the actions have no effect."""
    base: Controller
    """Controller whose pressure the action ``residual`` changes."""
    action: str = "pressure"
    """Kind of action, one of :data:`WALK_ACTION_KINDS`."""
    residual_bar: float = 1.0
    """Largest change of the pressure of the base controller [bar]."""
    walkers: Sequence[str | Path] | None = None
    """Shipped walkers or files from which an episode samples one; None: those that fit (see the environment)."""
    gain_noise: float = 0.0
    """Standard deviation of the gains of an episode over those of the walker [1]."""
    unevenness: float = 0.0
    """Largest height of the blocks on the ground [m]."""
    speed: float = 1.25
    """Target speed [m/s]."""
    duration: float = 20.0
    """Duration of an episode [s]."""
    time_step: float = MAX_DT
    """Time step [s]."""
    sensor_noise: float = 0.0
    """Multiple of the typical sensor noise (:data:`klute_sim.envs.tasks.instruments.OBSERVATIONS`)."""
    sensor_delay: int = 0
    """Sensor delay in whole intervals."""
    reward: Mapping[str, float] | None = None
    """Weights that replace those of :data:`klute_sim.envs.tasks.walk.reward.DEFAULT_WEIGHTS`."""

    def __post_init__(self) -> None:
        """Raise InputError when an option is outside its range."""
        if self.action not in WALK_ACTION_KINDS:
            raise InputError(f"action is '{self.action}'; allowed: {', '.join(WALK_ACTION_KINDS)}")
        check_action_limits(self.residual_bar, self.sensor_noise, self.sensor_delay)
        if self.prosthesis.spring_foot is None:
            check_accepts_pressure(self.prosthesis.device, "a policy of this environment")
        if not isinstance(self.base, PressureController) and self.base.interval != CONTROL_INTERVAL:
            raise InputError(
                f"the base controller commands every {1e3 * self.base.interval:g} ms; allowed: "
                f"{1e3 * CONTROL_INTERVAL:g} ms, the interval of the actions"
            )
        if self.walkers is not None and (isinstance(self.walkers, str) or not self.walkers):
            raise InputError("walkers is empty or one name; allowed: a list of names or files, such as ['machine-1']")
        if not 0.0 <= self.gain_noise <= MAX_GAIN_NOISE:
            raise InputError(f"gain_noise is {self.gain_noise:g}; allowed: 0 to {MAX_GAIN_NOISE:g}")
        if not 0.0 <= self.unevenness <= MAX_UNEVENNESS:
            raise InputError(f"unevenness is {self.unevenness:g}; allowed: 0 to {MAX_UNEVENNESS:g} m")
        if not 0.4 <= self.speed <= 2.5:
            raise InputError(f"speed is {self.speed:g}; allowed: 0.4 to 2.5 m/s")
        if not CONTROL_INTERVAL <= self.duration <= MAX_DURATION:
            raise InputError(f"duration is {self.duration:g} s; allowed: {CONTROL_INTERVAL:g} to {MAX_DURATION:g} s")
        steps = CONTROL_INTERVAL / self.time_step if 1e-5 <= self.time_step <= MAX_DT else 0.5
        if abs(steps - round(steps)) > 1e-6:
            raise InputError(f"time_step is {1e3 * self.time_step:g} ms; allowed: divisors of 10 ms up to 1 ms")
        resolve_weights(self.reward, DEFAULT_WEIGHTS)

    @property
    def actions_per_episode(self) -> int:
        """Return the number of intervals of an episode."""
        return round(self.duration / CONTROL_INTERVAL)

    @property
    def has_device(self) -> bool:
        """Return whether the actions have an effect."""
        return self.prosthesis.spring_foot is None
