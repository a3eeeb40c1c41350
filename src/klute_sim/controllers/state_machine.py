"""Finite-state machine on the sensors of a prosthesis: four states per stride with one pressure each.

Commercial powered ankles use this kind of controller. A load cell and an inertial sensor detect heel strike, roll-over
and toe-off, and each of these events starts a state (Sup et al. 2008; Au et al. 2009).
"""

from dataclasses import MISSING, dataclass, field, fields
from importlib import resources
from pathlib import Path
from typing import Any

from klute_sim.constants import DEGREES_PER_RADIAN
from klute_sim.controllers.feedback import SensorReadings
from klute_sim.errors import InputError
from klute_sim.files.limits import STATE_MACHINE
from klute_sim.files.toml import parse_toml, read_toml
from klute_sim.units import BAR

STATE_NAMES = ("loading", "rollover", "push_off", "swing")
"""States in the order of a stride."""


@dataclass(kw_only=True)
class StateMachine:
    """Pressures of the states [bar] and the thresholds that start them."""

    loading_bar: float
    """Pressure from foot strike on [bar]."""
    rollover_bar: float
    """Pressure at the start of roll-over [bar]; it rises to :attr:`rollover_end_bar` until push-off."""
    rollover_end_bar: float
    """Pressure at the end of roll-over [bar]."""
    push_off_bar: float
    """Pressure during push-off [bar]."""
    swing_bar: float
    """Pressure during swing [bar]."""
    strike_bw: float = 0.10
    """Load above which a foot strike is detected [body weights]."""
    lift_bw: float = 0.05
    """Load below which toe-off is detected [body weights]."""
    upright_deg: float = 0.0
    """Inclination of the shank, forward positive, at which roll-over begins [deg]."""
    lean_deg: float = 10.0
    """Inclination of the shank at which push-off begins [deg]."""
    interval: float = 0.01
    """Time between commands [s]."""
    state: str = field(default="loading", init=False)
    """Present state, one of :data:`STATE_NAMES`."""

    def __post_init__(self) -> None:
        """Raise InputError when a number is out of range or the thresholds are not in order."""
        pressures = {
            name: getattr(self, name)
            for name in ("loading_bar", "rollover_bar", "rollover_end_bar", "push_off_bar", "swing_bar")
        }
        for name, value in pressures.items():
            if not 0.0 <= value <= 20.0:  # also rejects NaN
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
        """Start in the state *loading*."""
        self.state = "loading"

    def command(self, readings: SensorReadings) -> float:
        """Return the commanded gauge pressure [Pa] until the next call."""
        lean = DEGREES_PER_RADIAN * readings.shank_angle
        self.state = self._select_next_state(readings.load, lean)
        if self.state != "rollover":
            return BAR * float(getattr(self, f"{self.state}_bar"))
        progress = min(max((lean - self.upright_deg) / (self.lean_deg - self.upright_deg), 0.0), 1.0)
        return BAR * (self.rollover_bar + progress * (self.rollover_end_bar - self.rollover_bar))

    def _select_next_state(self, load: float, lean: float) -> str:
        """Return the next state, which may be the present one.

        A stance that ends early, in a stumble, leads to swing, too. In the state *loading* the heel may bounce: a short
        time without load is not a swing while the shank leans back.
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
        """Return all numbers of the machine for the provenance of a recording (JSON types)."""
        return {"kind": "machine"} | {entry.name: getattr(self, entry.name) for entry in fields(self) if entry.init}


def load_default_state_machine() -> StateMachine:
    """Return the state machine of the package."""
    file = resources.files("klute_sim.controllers") / "state_machine.toml"
    return parse_state_machine(file.read_bytes(), "state_machine.toml")


def load_state_machine(path: str | Path) -> StateMachine:
    """Return the state machine in a TOML file with the fields of :class:`StateMachine`.

    Raises InputError when the file cannot be read or is not a state machine.
    """
    return _create_state_machine(read_toml(path, STATE_MACHINE), str(path))


def parse_state_machine(content: bytes, source: str) -> StateMachine:
    """Return the state machine in ``content`` (TOML, UTF-8); ``source`` names the file in errors."""
    return _create_state_machine(parse_toml(content, f"state machine {source}"), source)


def _create_state_machine(numbers: dict[str, Any], source: str) -> StateMachine:
    keys = {entry.name: entry for entry in fields(StateMachine) if entry.init}
    for name, value in numbers.items():
        if name not in keys:
            raise InputError(f"state machine {source}: unknown key '{name}'; allowed: {', '.join(keys)}")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"state machine {source}: '{name}' is {value!r}; allowed: a number")
    for name, key in keys.items():
        if key.default is MISSING and name not in numbers:
            raise InputError(f"state machine {source}: '{name}' is missing")
    try:
        return StateMachine(**numbers)
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
