"""The MJCF files, and models with devices in them."""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import mujoco

from klute_sim.device.backend.packing import LAYOUT_ID, pack_parameters
from klute_sim.device.dynamics import DeviceParameters, has_internal_state
from klute_sim.errors import InputError
from klute_sim.plant.coupling import DAMPING_INDEX, N_ALL_STATES, N_BASE_STATES, USER_ROW_SIZE


def get_models_folder() -> Path:
    """Folder of the MJCF files: inside an installed package, or beside ``src`` in a checkout."""
    inside = Path(str(resources.files("klute_sim"))) / "models"
    return inside if inside.is_dir() else Path(__file__).parents[3] / "models"


def load_spec(name: str) -> mujoco.MjSpec:
    """The editable model ``name`` (``ankle``, ``bench`` or ``gait_rig``)."""
    return mujoco.MjSpec.from_file(str(get_models_folder() / f"{name}.xml"))


def attach_devices(
    spec: mujoco.MjSpec, devices: Mapping[str, DeviceParameters], *, reserve_internal_states: bool = False
) -> mujoco.MjModel:
    """Compile ``spec`` with ``devices`` (actuator name -> parameters) on its actuators.

    The parameters travel in the model (``actuator_user``): its copies and pickles carry them. MuJoCo's automatic
    reset is off, because it would hide a simulation that has failed. Of MuJoCo's integrators RK4 takes the device's
    states with the rates of its last stage only: use the others.

    A device whose effects remember gets states for that; with ``memory`` every one does, so that a batch can give it
    any effects later.

    Raises InputError if an actuator is not made for a device, or is made for one and gets none: without it, it would
    silently give no force.
    """
    for name, parameters in devices.items():
        actuator = spec.actuator(name)
        if actuator is None:
            known = ", ".join(each.name for each in spec.actuators)
            raise InputError(f"the model has no actuator '{name}'; it has: {known}")
        obstacle = _find_incompatibility(spec, actuator)
        if obstacle:
            raise InputError(f"actuator '{name}' cannot carry a device: {obstacle}")
        shown = _expose_damping(spec, actuator, parameters)
        actuator.actdim = N_ALL_STATES if reserve_internal_states or has_internal_state(parameters) else N_BASE_STATES
        actuator.userdata = [*pack_parameters(parameters), shown]
    for actuator in spec.actuators:
        if actuator.name not in devices and not _carries_device(actuator) and not _find_incompatibility(spec, actuator):
            raise InputError(f"actuator '{actuator.name}' is made for a device and has none: it would give no force")
    if 0 <= spec.nuser_actuator < USER_ROW_SIZE:
        spec.nuser_actuator = USER_ROW_SIZE
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return spec.compile()


def _carries_device(actuator: mujoco.MjsActuator) -> bool:
    return len(actuator.userdata) >= USER_ROW_SIZE and actuator.userdata[0] == LAYOUT_ID


def _find_incompatibility(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> str:
    """Why ``actuator`` cannot carry a device, or ''."""
    made = (
        actuator.dyntype == mujoco.mjtDyn.mjDYN_USER
        and actuator.biastype == mujoco.mjtBias.mjBIAS_USER
        and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
        and actuator.gainprm[0] == 0.0
        and actuator.actdim in (N_BASE_STATES, N_ALL_STATES)
        and actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON
    )
    if not made:
        return "it must act on a tendon, with dyntype and biastype 'user', actdim 2 and gaintype 'fixed' with gainprm 0"
    if list(actuator.gear) != [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]:
        return "its gear must be 1"
    # MuJoCo would clip states and forces behind the device's back; the supply clips the command.
    for name in ("ctrlrange", "forcerange", "actrange"):
        if any(getattr(actuator, name)):
            return f"it must not have a {name}"
    if actuator.delay:
        return "it must not have a delay"
    tendon = spec.tendon(actuator.target)
    if tendon is not None and any(tendon.actfrcrange):
        return "its tendon must not have an actuatorfrcrange"
    return ""


def _expose_damping(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator, parameters: DeviceParameters) -> float:
    """Let MuJoCo's implicit integrators see the damper of a device that has no spring between damper and joint.

    They know nothing of a callback's derivative, and on a rigid tie the damper is too stiff without it. MuJoCo's
    tendons can have a damping ``c v|v|``, which is the orifice's law: the model's tendon gets it, with the larger of
    the two coefficients [N s2/m2], which is returned, and the device's force gives it back. Their sum is exact at every
    evaluation, as long as MuJoCo's dampers are not disabled.
    """
    tendon = spec.tendon(actuator.target)
    damping = [*tendon.damping, 0.0, 0.0, 0.0][:3]
    if _carries_device(actuator):  # a device before this one
        damping[1] -= actuator.userdata[DAMPING_INDEX]
    damper = parameters.damper
    shown = max(damper.concentric_coefficient, damper.eccentric_coefficient) if parameters.tendon.is_rigid else 0.0
    damping[1] += shown
    tendon.damping = damping
    return shown
