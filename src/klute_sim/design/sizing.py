"""From a target to a device: actuators, damper, tendon, and how well they do."""

from dataclasses import dataclass

import numpy as np

from klute_sim.control.pressure import Profile
from klute_sim.design import actuator, damper, demand, file, isometric, profile, tendon, velocity
from klute_sim.design.actuator import Need, Option
from klute_sim.design.choices import Choices
from klute_sim.design.damper import DamperDesign
from klute_sim.design.demand import Demand
from klute_sim.design.isometric import Bound
from klute_sim.design.target import Target, Walker
from klute_sim.design.velocity import Curves, Misfit
from klute_sim.device.files import Device
from klute_sim.errors import InputError
from klute_sim.units import BAR


@dataclass(frozen=True)
class Design:
    """A device, why it is so, and what it does. Everything is evaluated on the numbers of its file."""

    target: Target | Walker
    choices: Choices
    device: Device
    needed_force: float | None
    """Force that was asked for [N]; None: what the chosen actuators have."""
    force: float
    """F0 that the actuators have [N], at the supply's pressure and the design ratio."""
    option: Option
    """The actuators taken."""
    options: tuple[Option, ...]
    """What every row of Table 3.1 would have taken, the preferred first."""
    damper: DamperDesign
    curves: Curves
    envelope: tuple[Bound, ...]
    demand: Demand | None
    """Under :attr:`profile`; None: no walker."""
    profile: Profile | None
    """The tuned one, carried over to this device and this walker; None: no walker."""

    @property
    def muscle(self) -> Target:
        """The muscle whose force over velocity is copied."""
        return self.target.muscle if isinstance(self.target, Walker) else self.target

    def misfit(self) -> dict[str, Misfit]:
        """Distance to the muscle of actuator alone, with ideal damper, with fixed orifices."""
        c = self.curves
        return {name: velocity.misfit(c, getattr(c, name)) for name in ("alone", "ideal", "fixed")}


def design(target: Target | Walker, choices: Choices | None = None, name: str = "klute-design") -> Design:
    """Size a device for ``target``; raises InputError where that cannot be done.

    1. Force: F0 of the muscle at the design ratio, or the walker's peak moment over the moment arm, at the length that
       the muscle then has.
    2. Actuators: :func:`klute_sim.design.actuator.choose`.
    3. Damper: :func:`klute_sim.design.damper.size`, on the F0 that these actuators have.
    4. Tendon: :func:`klute_sim.design.tendon.size`, on a walker's peak force, or on the actuators' F0.
    """
    choices = choices or Choices()
    assumed = choices.assumptions
    muscle = target.muscle if isinstance(target, Walker) else target
    need = _need(target, choices)
    if need is None and (choices.actuator is None or choices.count is None):
        raise InputError("without a force or a walker, both actuator and count have to be given")
    anything = Need(0.0, lambda resting: assumed.design_ratio, _length(muscle, choices))
    option, options = actuator.choose(need or anything, choices)
    if option.force <= 0.0:
        raise InputError(
            f"{option.actuator} has no force left at {choices.supply_pressure / BAR:g} bar and "
            f"{assumed.design_ratio:g} of its resting length"
        )
    damping = damper.size(muscle, option.total, choices)
    pull = need.force if need and isinstance(target, Walker) else option.total
    springs = tendon.size(pull, option.resting_length, assumed)
    made = file.device(name, target, option, damping, springs, pull, need.force if need else 0.0, choices)
    parameters = made.parameters
    if assumed.discharge != damper.DESIGN_DISCHARGE:
        parameters = parameters._replace(damper=damping.law())

    slow, fast = damping.eccentric.speed, damping.concentric.speed
    force_velocity = velocity.curves(
        parameters.muscle,
        parameters.damper,
        muscle.hill,
        muscle.velocity,
        velocity.grid(slow, fast),
        choices.supply_pressure,
        assumed.design_ratio,
    )
    shortening = force_velocity.velocity >= 0.0
    shape = isometric.hyperbola(
        np.asarray(force_velocity.velocity[shortening] / muscle.velocity),
        np.asarray(force_velocity.fixed[shortening] / force_velocity.isometric),
    )
    saturation = float(force_velocity.fixed[0] / force_velocity.isometric)
    asked, own = None, None
    if isinstance(target, Walker):
        lies = demand.posture(parameters, assumed.neutral_ratio, assumed.moment_arm, target)
        own = profile.carried_over(parameters, target.mass, lies)
        asked = demand.over_stride(parameters, target, lies, own)
    return Design(
        target=target,
        choices=choices,
        device=made,
        needed_force=need.force if need else None,
        force=option.total,
        option=option,
        options=tuple(options),
        damper=damping,
        curves=force_velocity,
        envelope=tuple(
            isometric.envelope(isometric.parabola(parameters.muscle, choices.supply_pressure), shape, saturation)
        ),
        demand=asked,
        profile=own,
    )


def _length(muscle: Target, choices: Choices) -> float | None:
    """L0 [m] where somebody fixed it."""
    return muscle.resting_length if choices.resting_length is None else choices.resting_length


def _need(target: Target | Walker, choices: Choices) -> Need | None:
    """What ``target`` asks of the actuators; None where it leaves that open."""
    assumed = choices.assumptions
    if isinstance(target, Walker):
        moment, angle = target.peak()
        travel = assumed.moment_arm * angle

        def at_peak(resting: float) -> float:
            stretch = assumed.tendon_strain * (assumed.slack_length + resting)
            return min(1.0, assumed.neutral_ratio + (travel - stretch) / resting)

        excursion = target.motion_range() * assumed.moment_arm
        return Need(moment / assumed.moment_arm, at_peak, _length(target.muscle, choices), excursion)
    if target.isometric_force is None:
        return None
    return Need(target.isometric_force, lambda resting: assumed.design_ratio, _length(target, choices))
