"""What a user can change while a simulation runs, and the keys for it."""

from dataclasses import dataclass, replace

from klute_sim.errors import InputError

SCENES = ("gait", "bench", "walk")
"""What can be played: the gait rig, the tester, and a person who walks by reflexes."""
PRESSURE_STEP_BAR, SPEED_STEP, SLOPE_STEP_DEG = 0.25, 0.1, 1.0
"""Changes by one key press: pressure [bar], speed [m/s], slope [deg]."""
KEY_UP, KEY_DOWN, KEY_LEFT, KEY_RIGHT, KEY_PAGE_UP, KEY_PAGE_DOWN, KEY_HOME, KEY_ENTER = (
    *(265, 264, 263, 262, 266, 267, 268, 257),
)
"""Codes of GLFW."""
KEY_HELP = {
    "gait": ("up/down pressure", "left/right speed", "page up/down slope", "enter pause", "home restart"),
    "bench": ("up/down pressure", "enter pause", "home restart"),
    "walk": ("up/down pressure", "enter pause", "home restart"),
}
"""Keys of each scene."""


@dataclass(frozen=True, kw_only=True)
class Controls:
    """State of the controls; validated when made."""

    scene: str
    """One of :data:`SCENES`."""
    max_pressure_bar: float
    """Supply pressure [bar]."""
    pressure_bar: float = 0.0
    """Gauge pressure on the tester; a change of the pressure of the controller in gait and walk [bar]."""
    speed: float = 1.2
    """Walking speed on the gait rig [m/s]."""
    slope_deg: float = 0.0
    """Slope of the gait rig's ground [deg], uphill positive."""
    is_paused: bool = False
    """Whether time stands still."""
    n_restarts: int = 0
    """Number of restarts that the user asked for."""

    def __post_init__(self) -> None:
        """Raise InputError when the scene is unknown or the pressure is out of range."""
        if self.scene not in SCENES:
            raise InputError(f"there is no scene '{self.scene}' to play; allowed: {', '.join(SCENES)}")
        lowest, highest = self.pressure_range
        if not lowest <= self.pressure_bar <= highest:
            raise InputError(f"pressure is {self.pressure_bar:g} bar; allowed: {lowest:g} to {highest:g} bar")

    @property
    def pressure_range(self) -> tuple[float, float]:
        """Lowest and highest :attr:`pressure_bar`."""
        return (0.0 if self.scene == "bench" else -self.max_pressure_bar), self.max_pressure_bar

    def press(self, key: int) -> "Controls":
        """Return the controls after a key press; an unknown key changes nothing, and no control leaves its range."""
        signs = {KEY_UP: 1.0, KEY_DOWN: -1.0, KEY_RIGHT: 1.0, KEY_LEFT: -1.0, KEY_PAGE_UP: 1.0, KEY_PAGE_DOWN: -1.0}
        sign = signs.get(key, 0.0)
        if key in (KEY_UP, KEY_DOWN):
            lowest, highest = self.pressure_range
            pressure = min(max(self.pressure_bar + sign * PRESSURE_STEP_BAR, lowest), highest)
            return replace(self, pressure_bar=pressure)
        if key == KEY_ENTER:
            return replace(self, is_paused=not self.is_paused)
        if key == KEY_HOME:
            return replace(self, n_restarts=self.n_restarts + 1)
        if self.scene == "gait" and key in (KEY_LEFT, KEY_RIGHT):
            return replace(self, speed=round(self.speed + sign * SPEED_STEP, 6))
        if self.scene == "gait" and key in (KEY_PAGE_UP, KEY_PAGE_DOWN):
            return replace(self, slope_deg=self.slope_deg + sign * SLOPE_STEP_DEG)
        return self

    def describe(self) -> str:
        """Return the controls and their keys, one per line."""
        lines = [f"pressure {self.pressure_bar:.2f} bar"]
        if self.scene != "bench":
            lines = [f"pressure of the controller {self.pressure_bar:+.2f} bar"]
        if self.scene == "gait":
            lines.append(f"{self.speed:.1f} m/s, slope {self.slope_deg:g} deg")
        return "\n".join([*lines, "", *KEY_HELP[self.scene]])
