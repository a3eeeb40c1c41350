"""A finite-state machine on a prosthesis' own sensors: four states of a stride, a pressure in each.

The kind of controller that powered ankles are sold with: heel strike, the shank passing over the foot, and toe-off are
seen by a load cell and an inertial sensor, and each begins a state (Sup et al. 2008; Au et al. 2009).
"""

from dataclasses import dataclass, field
from typing import Any

from klute_sim.control.feedback import Sensed
from klute_sim.errors import InputError
from klute_sim.units import BAR

STATES = ("loading", "rollover", "push_off", "swing")


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

    def begin(self) -> None:
        """See :class:`~klute_sim.control.feedback.FeedbackController`."""
        self.state = "loading"

    def command(self, sensed: Sensed) -> float:
        """See :class:`~klute_sim.control.feedback.FeedbackController`."""
        lean = 57.29577951308232 * sensed.shank_angle
        self.state = self._next(sensed.load, lean)
        if self.state != "rollover":
            return BAR * float(getattr(self, f"{self.state}_bar"))
        way = min(max((lean - self.upright_deg) / (self.lean_deg - self.upright_deg), 0.0), 1.0)
        return BAR * (self.rollover_bar + way * (self.rollover_end_bar - self.rollover_bar))

    def _next(self, load: float, lean: float) -> str:
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
        """See :class:`~klute_sim.control.feedback.FeedbackController`."""
        own = ("loading_bar", "rollover_bar", "rollover_end_bar", "push_off_bar", "swing_bar", "strike_bw", "lift_bw")
        return {"kind": "machine"} | {
            name: getattr(self, name) for name in (*own, "upright_deg", "lean_deg", "interval")
        }
