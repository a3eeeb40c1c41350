"""A finite-state machine on a prosthesis' own sensors: four states of a stride, a pressure in each.

The kind of controller that powered ankles are sold with: heel strike, the shank passing over the foot, and toe-off are
seen by a load cell and an inertial sensor, and each begins a state (Sup et al. 2008; Au et al. 2009).
"""

import tomllib
from dataclasses import MISSING, dataclass, field, fields
from importlib import resources
from pathlib import Path
from typing import Any

from klute_sim.controllers.feedback import SensorReadings
from klute_sim.errors import InputError
from klute_sim.units import BAR

STATE_NAMES = ("loading", "rollover", "push_off", "swing")


@dataclass(kw_only=True)
class StateMachine:
    """Pressures of the states [bar], and what begins them; InputError for a machine that could never go round."""

    loading_bar: float
    """From foot strike on."""
    rollover_bar: float
    """Where the shank begins to lean forward; rises to :attr:`rollover_end_bar` at push-off."""
    rollover_end_bar: float
    push_off_bar: float
    swing_bar: float
    strike_bw: float = 0.10
    """Load above which the foot has struck [body weights]."""
    lift_bw: float = 0.05
    """Load below which it has left [body weights]."""
    upright_deg: float = 0.0
    """Inclination of the shank, forward positive, at which it rolls over."""
    lean_deg: float = 10.0
    """Inclination of the shank at which push-off begins."""
    interval: float = 0.01
    """Between commands [s]."""
    state: str = field(default="loading", init=False)
    """One of :data:`STATES`."""

    def __post_init__(self) -> None:
        """See the class."""
        pressures = {
            name: getattr(self, name)
            for name in ("loading_bar", "rollover_bar", "rollover_end_bar", "push_off_bar", "swing_bar")
        }
        for name, value in pressures.items():
            if not 0.0 <= value <= 20.0:  # also refuses NaN
                raise InputError(f"{name} of the state machine is {value:g}; allowed: 0 to 20 bar")
        if not 0.0 < self.lift_bw < self.strike_bw < 1.0:
            raise InputError(
                f"the state machine's loads are {self.lift_bw:g} and {self.strike_bw:g}; allowed: "
                "0 < lift_bw < strike_bw < 1 body weight"
            )
        if not -30.0 < self.upright_deg < self.lean_deg < 60.0:
            raise InputError(
                f"the state machine's inclinations are {self.upright_deg:g} and {self.lean_deg:g}; allowed: "
                "-30 < upright_deg < lean_deg < 60 degrees"
            )

        if not 1e-3 <= self.interval <= 0.1:
            raise InputError(f"interval of the state machine is {self.interval:g}; allowed: 0.001 to 0.1 s")

    def reset(self) -> None:
        """See :class:`~klute_sim.controllers.feedback.FeedbackController`."""
        self.state = "loading"

    def command(self, readings: SensorReadings) -> float:
        """See :class:`~klute_sim.controllers.feedback.FeedbackController`."""
        lean = 57.29577951308232 * readings.shank_angle
        self.state = self._select_next_state(readings.load, lean)
        if self.state != "rollover":
            return BAR * float(getattr(self, f"{self.state}_bar"))
        way = min(max((lean - self.upright_deg) / (self.lean_deg - self.upright_deg), 0.0), 1.0)
        return BAR * (self.rollover_bar + way * (self.rollover_end_bar - self.rollover_bar))

    def _select_next_state(self, load: float, lean: float) -> str:
        """The state after the present one, or the present one.

        A stance that is broken off early, by a stumble, ends in swing, too; only in loading, as the heel bounces, a
        moment without load is no swing while the shank leans back.
        """
        if self.state == "swing":
            return "loading" if load > self.strike_bw else "swing"
        if load < self.lift_bw and (self.state != "loading" or lean > self.upright_deg):
            return "swing"
        if self.state == "loading" and lean > self.upright_deg:
            return "rollover"
        if self.state == "rollover" and lean > self.lean_deg:
            return "push_off"
        return self.state

    def describe(self) -> dict[str, Any]:
        """See :class:`~klute_sim.controllers.feedback.FeedbackController`."""
        return {"kind": "machine"} | {each.name: getattr(self, each.name) for each in fields(self) if each.init}


def load_default_state_machine() -> StateMachine:
    """The package's own."""
    file = resources.files("klute_sim.controllers") / "state_machine.toml"
    return parse_state_machine(file.read_text("utf-8"), "state_machine.toml")


def load_state_machine(path: str | Path) -> StateMachine:
    """The state machine in a TOML file of :class:`StateMachine`'s numbers; raises InputError."""
    try:
        text = Path(path).read_text("utf-8-sig")  # some editors put a mark in front
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not a UTF-8 text file"
        raise InputError(f"state machine {path} cannot be read: {reason}") from None
    return parse_state_machine(text, str(path))


def parse_state_machine(text: str, source: str) -> StateMachine:
    """The state machine that TOML ``text`` holds; ``where`` names it in errors."""
    try:
        numbers = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"state machine {source} is no TOML file: {error}") from None
    own = {each.name: each for each in fields(StateMachine) if each.init}
    for name, value in numbers.items():
        if name not in own:
            raise InputError(f"state machine {source}: there is no '{name}'; there are: {', '.join(own)}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"state machine {source}: '{name}' is {value!r}; allowed: a number")
    for name, each in own.items():
        if each.default is MISSING and name not in numbers:
            raise InputError(f"state machine {source}: '{name}' is missing")
    try:
        return StateMachine(**numbers)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
