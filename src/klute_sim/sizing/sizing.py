"""From a target to a device: actuators, damper, tendon, and how well they do."""

from dataclasses import dataclass

import numpy as np

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.device import Device
from klute_sim.errors import InputError
from klute_sim.sizing import device_file
from klute_sim.sizing.choices import DesignChoices
from klute_sim.sizing.evaluation import demand, isometric, velocity
from klute_sim.sizing.evaluation.demand import StrideDemand
from klute_sim.sizing.evaluation.isometric import EnvelopeBound
from klute_sim.sizing.evaluation.velocity import ForceVelocityCurves, ForceVelocityError
from klute_sim.sizing.parts import actuator, damper, profile, tendon
from klute_sim.sizing.parts.actuator import ActuatorOption, ActuatorRequirement
from klute_sim.sizing.parts.damper import DamperDesign
from klute_sim.sizing.target import MuscleTarget, WalkerTarget
from klute_sim.units import BAR


@dataclass(frozen=True)
class Design:
    """A device, why it is so, and what it does. Everything is evaluated on the numbers of its file."""

    target: MuscleTarget | WalkerTarget
    choices: DesignChoices
    device: Device
    required_force: float | None
    """Force that was asked for [N]; None: what the chosen actuators have."""
    isometric_force: float
    """F0 that the actuators have [N], at the supply's pressure and the design ratio."""
    selected: ActuatorOption
    """The actuators taken."""
    candidates: tuple[ActuatorOption, ...]
    """What every row of Table 3.1 would have taken, the preferred first."""
    damper: DamperDesign
    curves: ForceVelocityCurves
    envelope: tuple[EnvelopeBound, ...]
    demand: StrideDemand | None
    """Under :attr:`profile`; None: no walker."""
    profile: PressureProfile | None
    """The tuned one, carried over to this device and this walker; None: no walker."""

    @property
    def muscle(self) -> MuscleTarget:
        """The muscle whose force over velocity is copied."""
        return self.target.muscle if isinstance(self.target, WalkerTarget) else self.target

    def compute_force_velocity_errors(self) -> dict[str, ForceVelocityError]:
        """Distance to the muscle of actuator alone, with ideal damper, with fixed orifices."""
        c = self.curves
        return {name: velocity.compute_rms_error(c, getattr(c, name)) for name in ("alone", "ideal", "fixed")}


def design_device(
    target: MuscleTarget | WalkerTarget, choices: DesignChoices | None = None, name: str = "klute-design"
) -> Design:
    """Size a device for ``target``; raises InputError where that cannot be done.

    1. Force: F0 of the muscle at the design ratio, or the walker's peak moment over the moment arm, at the length that
       the muscle then has.
    2. Actuators: :func:`klute_sim.sizing.parts.actuator.choose`.
    3. Damper: :func:`klute_sim.sizing.parts.damper.size`, on the F0 that these actuators have.
    4. Tendon: :func:`klute_sim.sizing.parts.tendon.size`, on a walker's peak force, or on the actuators' F0.
    """
    choices = choices or DesignChoices()
    assumed = choices.assumptions
    muscle = target.muscle if isinstance(target, WalkerTarget) else target
    need = _derive_requirement(target, choices)
    if need is None and (choices.actuator is None or choices.count is None):
        raise InputError("without a force or a walker, both actuator and count have to be given")
    anything = ActuatorRequirement(0.0, lambda resting: assumed.design_ratio, _fixed_resting_length(muscle, choices))
    option, options = actuator.select_actuators(need or anything, choices)
    if option.isometric_force <= 0.0:
        raise InputError(
            f"{option.actuator} has no force left at {choices.supply_pressure / BAR:g} bar and "
            f"{assumed.design_ratio:g} of its resting length"
        )
    damping = damper.size_damper(muscle, option.total_force, choices)
    pull = need.force if need and isinstance(target, WalkerTarget) else option.total_force
    springs = tendon.size_tendon(pull, option.resting_length, assumed)
    made = device_file.build_device(name, target, option, damping, springs, pull, need.force if need else 0.0, choices)
    parameters = made.parameters
    if assumed.discharge_coefficient != damper.DESIGN_DISCHARGE_COEFFICIENT:
        parameters = parameters._replace(damper=damping.to_damper())

    slow, fast = damping.eccentric.speed, damping.concentric.speed
    force_velocity = velocity.compute_force_velocity(
        parameters.muscle,
        parameters.damper,
        muscle.hill,
        muscle.design_peak_velocity,
        velocity.velocity_grid(slow, fast),
        choices.supply_pressure,
        assumed.design_ratio,
    )
    shortening = force_velocity.velocity >= 0.0
    shape = isometric.fit_hyperbola(
        np.asarray(force_velocity.velocity[shortening] / muscle.design_peak_velocity),
        np.asarray(force_velocity.fixed_orifices[shortening] / force_velocity.isometric),
    )
    saturation = float(force_velocity.fixed_orifices[0] / force_velocity.isometric)
    asked, own = None, None
    if isinstance(target, WalkerTarget):
        lies = demand.compute_stride_geometry(parameters, assumed.neutral_ratio, assumed.moment_arm, target)
        own = profile.transfer_profile(parameters, target.mass, lies)
        asked = demand.compute_stride_demand(parameters, target, lies, own)
    return Design(
        target=target,
        choices=choices,
        device=made,
        required_force=need.force if need else None,
        isometric_force=option.total_force,
        selected=option,
        candidates=tuple(options),
        damper=damping,
        curves=force_velocity,
        envelope=tuple(
            isometric.compare_with_envelope(
                isometric.fit_parabola(parameters.muscle, choices.supply_pressure), shape, saturation
            )
        ),
        demand=asked,
        profile=own,
    )


def _fixed_resting_length(muscle: MuscleTarget, choices: DesignChoices) -> float | None:
    """L0 [m] where somebody fixed it."""
    return muscle.resting_length if choices.resting_length is None else choices.resting_length


def _derive_requirement(target: MuscleTarget | WalkerTarget, choices: DesignChoices) -> ActuatorRequirement | None:
    """What ``target`` asks of the actuators; None where it leaves that open."""
    assumed = choices.assumptions
    if isinstance(target, WalkerTarget):
        moment, angle = target.compute_peak_moment()
        travel = assumed.moment_arm * angle

        def at_peak(resting: float) -> float:
            stretch = assumed.tendon_strain * (assumed.slack_length + resting)
            return min(1.0, assumed.neutral_ratio + (travel - stretch) / resting)

        excursion = target.ankle_range_of_motion() * assumed.moment_arm
        return ActuatorRequirement(
            moment / assumed.moment_arm, at_peak, _fixed_resting_length(target.muscle, choices), excursion
        )
    if target.isometric_force is None:
        return None
    return ActuatorRequirement(
        target.isometric_force, lambda resting: assumed.design_ratio, _fixed_resting_length(target, choices)
    )
