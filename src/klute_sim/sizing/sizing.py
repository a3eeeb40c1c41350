"""The complete sizing: from a target to a device with actuators, damper and tendon, and its evaluation."""

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
    """A sized device with its requirement and its performance, evaluated on the numbers of its device file."""

    target: MuscleTarget | WalkerTarget
    """Muscle or walker for which the device was sized."""
    choices: DesignChoices
    """Choices of the user."""
    device: Device
    """Sized device."""
    required_force: float | None
    """Required isometric force [N]; None where the target leaves it to the chosen actuators."""
    isometric_force: float
    """F0 of the selected actuators [N] at the supply pressure and the design ratio."""
    selected: ActuatorOption
    """Selected actuators."""
    candidates: tuple[ActuatorOption, ...]
    """Options of all presets of Table 3.1 in order of preference."""
    damper: DamperDesign
    """Sized damper."""
    curves: ForceVelocityCurves
    """Force-velocity curves."""
    envelope: tuple[EnvelopeBound, ...]
    """Comparison with the design envelope (2.5)."""
    demand: StrideDemand | None
    """Demand of a stride under :attr:`profile`; None without a walker."""
    profile: PressureProfile | None
    """Tuned profile transferred to this device and this walker; None without a walker."""

    @property
    def muscle(self) -> MuscleTarget:
        """Return the muscle whose force-velocity curve is emulated."""
        return self.target.muscle if isinstance(self.target, WalkerTarget) else self.target

    def compute_force_velocity_errors(self) -> dict[str, ForceVelocityError]:
        """Return the deviation from the muscle of the bare actuator, of an ideal damper and of fixed orifices."""
        curves = self.curves
        forces = {name: getattr(curves, name) for name in ("actuator_only", "ideal_damper", "fixed_orifices")}
        return {name: velocity.compute_rms_error(curves, force) for name, force in forces.items()}


def design_device(
    target: MuscleTarget | WalkerTarget, choices: DesignChoices | None = None, name: str = "klute-design"
) -> Design:
    """Size a device for ``target``; raises InputError when no such device can be sized.

    1. Force: F0 of the muscle at the design ratio, or the peak moment of the walker over the moment arm at the muscle
    length of that moment.
    2. Actuators: :func:`klute_sim.sizing.parts.actuator.select_actuators`.
    3. Damper: :func:`klute_sim.sizing.parts.damper.size_damper` on F0 of the selected actuators.
    4. Tendon: :func:`klute_sim.sizing.parts.tendon.size_tendon` on the peak force of a walker, or on F0 of the
    actuators.
    """
    choices = choices or DesignChoices()
    assumptions = choices.assumptions
    muscle = target.muscle if isinstance(target, WalkerTarget) else target
    requirement = _derive_requirement(target, choices)
    if requirement is None and (choices.actuator is None or choices.count is None):
        raise InputError("neither a force nor a subject determines the size: give both actuator and count")
    unconstrained = ActuatorRequirement(
        0.0, lambda resting_length: assumptions.design_ratio, _fixed_resting_length(muscle, choices)
    )
    selected, candidates = actuator.select_actuators(requirement or unconstrained, choices)
    if selected.isometric_force <= 0.0:
        raise InputError(
            f"{selected.actuator} has no force left at {choices.supply_pressure / BAR:g} bar and "
            f"{assumptions.design_ratio:g} of its resting length"
        )
    damper_design = damper.size_damper(muscle, selected.total_force, choices)
    tendon_force = requirement.force if requirement and isinstance(target, WalkerTarget) else selected.total_force
    tendon_parameters = tendon.size_tendon(tendon_force, selected.resting_length, assumptions)
    device = device_file.build_device(
        name,
        target,
        selected,
        damper_design,
        tendon_parameters,
        tendon_force,
        requirement.force if requirement else 0.0,
        choices,
    )
    parameters = device.parameters
    if assumptions.discharge_coefficient != damper.DESIGN_DISCHARGE_COEFFICIENT:
        parameters = parameters._replace(damper=damper_design.to_damper())

    lengthening_speed, shortening_speed = damper_design.eccentric.speed, damper_design.concentric.speed
    force_velocity = velocity.compute_force_velocity(
        parameters.muscle,
        parameters.damper,
        muscle.hill,
        muscle.design_peak_velocity,
        velocity.build_velocity_grid(lengthening_speed, shortening_speed),
        choices.supply_pressure,
        assumptions.design_ratio,
    )
    is_shortening = force_velocity.velocity >= 0.0
    shape = isometric.fit_hyperbola(
        np.asarray(force_velocity.velocity[is_shortening] / muscle.design_peak_velocity),
        np.asarray(force_velocity.fixed_orifices[is_shortening] / force_velocity.isometric),
    )
    saturation = float(force_velocity.fixed_orifices[0] / force_velocity.isometric)
    stride_demand, transferred_profile = None, None
    if isinstance(target, WalkerTarget):
        geometry = demand.compute_stride_geometry(parameters, assumptions.neutral_ratio, assumptions.moment_arm, target)
        transferred_profile = profile.transfer_profile(parameters, target.mass, geometry)
        stride_demand = demand.compute_stride_demand(parameters, target, geometry, transferred_profile)
    return Design(
        target=target,
        choices=choices,
        device=device,
        required_force=requirement.force if requirement else None,
        isometric_force=selected.total_force,
        selected=selected,
        candidates=tuple(candidates),
        damper=damper_design,
        curves=force_velocity,
        envelope=tuple(
            isometric.compare_with_envelope(
                isometric.fit_parabola(parameters.muscle, choices.supply_pressure), shape, saturation
            )
        ),
        demand=stride_demand,
        profile=transferred_profile,
    )


def _fixed_resting_length(muscle: MuscleTarget, choices: DesignChoices) -> float | None:
    """Return the resting length L0 [m] where choices or target fix it."""
    return muscle.resting_length if choices.resting_length is None else choices.resting_length


def _derive_requirement(target: MuscleTarget | WalkerTarget, choices: DesignChoices) -> ActuatorRequirement | None:
    """Return the requirement of ``target`` on the actuators; None where the target has no force."""
    assumptions = choices.assumptions
    if isinstance(target, WalkerTarget):
        moment, angle = target.compute_peak_moment()
        travel = assumptions.moment_arm * angle

        def ratio_at_peak(resting_length: float) -> float:
            stretch = assumptions.tendon_strain * (assumptions.slack_length + resting_length)
            return min(1.0, assumptions.neutral_ratio + (travel - stretch) / resting_length)

        excursion = target.compute_ankle_range_of_motion() * assumptions.moment_arm
        return ActuatorRequirement(
            moment / assumptions.moment_arm, ratio_at_peak, _fixed_resting_length(target.muscle, choices), excursion
        )
    if target.isometric_force is None:
        return None
    return ActuatorRequirement(
        target.isometric_force, lambda resting_length: assumptions.design_ratio, _fixed_resting_length(target, choices)
    )
