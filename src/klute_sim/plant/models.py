"""MJCF files, and MuJoCo models with devices on their actuators."""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import mujoco

from klute_sim.device.backend.packing import LAYOUT_ID, pack_parameters
from klute_sim.device.dynamics import DeviceParameters, has_internal_state
from klute_sim.errors import InputError
from klute_sim.plant.callbacks import compile_model
from klute_sim.plant.coupling import DAMPING_INDEX, N_ALL_STATES, N_BASE_STATES, USER_ROW_SIZE

N_VISIBLE_GROUPS = 3
"""Groups of geoms that MuJoCo's viewer shows unless told otherwise: 0 to 2. Group 3 of our models holds contact."""
REST_GROUP = 1
"""Group of the geoms of our models that show muscles at rest, for viewers that cannot draw ones that swell."""


def get_models_folder() -> Path:
    """Return the folder of the MJCF files: in an installed package, or next to ``src`` in a checkout."""
    packaged_folder = Path(str(resources.files("klute_sim"))) / "models"
    return packaged_folder if packaged_folder.is_dir() else Path(__file__).parents[3] / "models"


def load_spec(name: str) -> mujoco.MjSpec:
    """Return the editable model ``name`` (``ankle``, ``bench``, ``gait_rig`` or ``walker``) without its keyframes.

    A keyframe has as many numbers as the file has coordinates and states, which devices and elastic feet change.
    """
    spec = mujoco.MjSpec.from_file(str(get_models_folder() / f"{name}.xml"))
    for key in list(spec.keys):
        spec.delete(key)
    return spec


def attach_devices(
    spec: mujoco.MjSpec, devices: Mapping[str, DeviceParameters], *, reserve_internal_states: bool = False
) -> mujoco.MjModel:
    """Compile ``spec`` with ``devices`` (name of the actuator -> parameters) on its actuators.

    The model stores the parameters (``actuator_user``), so its copies and pickles contain them. MuJoCo's automatic
    reset is disabled, because it would hide a failed simulation. Use any integrator of MuJoCo except RK4, which
    advances the device's states with the rates of its last stage only.

    A device with internal states gets room for them. With ``reserve_internal_states`` every device does, so that a
    batch can activate any effects later.

    Raises InputError when an actuator cannot carry a device, or when an actuator made for a device gets none: without a
    device it would give no force.
    """
    for name, parameters in devices.items():
        actuator = spec.actuator(name)
        if actuator is None:
            names = ", ".join(known.name for known in spec.actuators)
            raise InputError(f"the model has no actuator '{name}'; it has: {names}")
        incompatibility = _find_incompatibility(spec, actuator)
        if incompatibility:
            raise InputError(f"actuator '{name}' cannot carry a device: {incompatibility}")
        damping = _expose_damping(spec, actuator, parameters)
        actuator.actdim = N_ALL_STATES if reserve_internal_states or has_internal_state(parameters) else N_BASE_STATES
        actuator.userdata = [*pack_parameters(parameters), damping]
    for actuator in spec.actuators:
        if actuator.name not in devices and not _carries_device(actuator) and not _find_incompatibility(spec, actuator):
            raise InputError(
                f"actuator '{actuator.name}' is made for a device and has none, so it would give no force; attach a "
                "device to it"
            )
    if 0 <= spec.nuser_actuator < USER_ROW_SIZE:
        spec.nuser_actuator = USER_ROW_SIZE
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return compile_model(spec)


def _carries_device(actuator: mujoco.MjsActuator) -> bool:
    return len(actuator.userdata) >= USER_ROW_SIZE and actuator.userdata[0] == LAYOUT_ID


def _find_incompatibility(spec: mujoco.MjSpec, actuator: mujoco.MjsActuator) -> str:
    """Return the reason why ``actuator`` cannot carry a device; '' if it can."""
    has_right_types = (
        actuator.dyntype == mujoco.mjtDyn.mjDYN_USER
        and actuator.biastype == mujoco.mjtBias.mjBIAS_USER
        and actuator.gaintype == mujoco.mjtGain.mjGAIN_FIXED
        and actuator.gainprm[0] == 0.0
        and actuator.actdim in (N_BASE_STATES, N_ALL_STATES)
        and actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON
    )
    if not has_right_types:
        return "it must act on a tendon, with dyntype and biastype 'user', actdim 2 and gaintype 'fixed' with gainprm 0"
    if list(actuator.gear) != [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]:
        return "its gear must be 1"
    # MuJoCo would clip states and forces without the device's knowledge; the supply clips the command.
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
    """Show the damper of a device without elastic tendon to MuJoCo's implicit integrators.

    The integrators do not know the derivative of a callback, and on a rigid tendon the damper is too stiff without it.
    MuJoCo's tendons have a damping ``c v|v|``, which is the law of the orifice. The model's tendon therefore gets the
    larger of the two coefficients [N s2/m2], and the device's force compensates it. Their sum is exact at every
    evaluation unless MuJoCo's dampers are disabled. Returns the coefficient.
    """
    tendon = spec.tendon(actuator.target)
    damping = [*tendon.damping, 0.0, 0.0, 0.0][:3]
    if _carries_device(actuator):  # remove the damping of the device that is replaced
        damping[1] -= actuator.userdata[DAMPING_INDEX]
    damper = parameters.damper
    coefficient = (
        max(damper.concentric_coefficient, damper.eccentric_coefficient) if parameters.tendon.is_rigid else 0.0
    )
    damping[1] += coefficient
    tendon.damping = damping
    return coefficient
