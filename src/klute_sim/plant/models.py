"""The MJCF files, and models with devices in them."""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path

import mujoco

from klute_sim.device.step import Parameters
from klute_sim.device.vector import pack
from klute_sim.errors import InputError
from klute_sim.plant.coupling import SHOWN_DAMPING
from klute_sim.plant.router import row_of


def folder() -> Path:
    """Folder of the MJCF files: inside an installed package, or beside ``src`` in a checkout."""
    inside = Path(str(resources.files("klute_sim"))) / "models"
    return inside if inside.is_dir() else Path(__file__).parents[3] / "models"


def spec(name: str) -> mujoco.MjSpec:
    """The editable model ``name`` (``ankle``, ``bench`` or ``gait_rig``)."""
    return mujoco.MjSpec.from_file(str(folder() / f"{name}.xml"))


def equip(spec: mujoco.MjSpec, devices: Mapping[str, Parameters]) -> mujoco.MjModel:
    """Compile ``spec`` with ``devices`` (actuator name -> parameters) on its actuators.

    The parameters travel in the model (``actuator_user``): its copies and pickles carry them. MuJoCo's automatic
    reset is off, because it would hide a simulation that has failed.

    Raises InputError if an actuator is not made for a device, or is made for one and gets none: without it, it would
    silently give no force.
    """
    for name, parameters in devices.items():
        actuator = spec.actuator(name)
        if actuator is None:
            known = ", ".join(each.name for each in spec.actuators)
            raise InputError(f"the model has no actuator '{name}'; it has: {known}")
        actuator.userdata = [*pack(parameters), 0.0]
    model = spec.compile()
    for actuator in range(model.nactuator):
        carries, name = row_of(model, actuator) is not None, model.actuator(actuator).name
        if carries and not made_for_device(model, actuator):
            raise InputError(
                f"actuator '{name}' cannot carry a device: it must act on a tendon, with dyntype and biastype 'user', "
                "actdim 2 and gaintype 'fixed' with gainprm 0"
            )
        if made_for_device(model, actuator) and not carries:
            raise InputError(f"actuator '{name}' is made for a device and has none: it would give no force")
    for name, parameters in devices.items():
        _show_damping(model, name, parameters)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    return model


def made_for_device(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether ``actuator`` is shaped for a device: two states, a force of its own, on a tendon."""
    return bool(
        model.actuator_dyntype[actuator] == mujoco.mjtDyn.mjDYN_USER
        and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_USER
        and model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_gainprm[actuator, 0] == 0.0
        and model.actuator_actnum[actuator] == 2
        and model.actuator_trntype[actuator] == mujoco.mjtTrn.mjTRN_TENDON
    )


def _show_damping(model: mujoco.MjModel, name: str, parameters: Parameters) -> None:
    """Let MuJoCo's implicit integrators see the damper of a device that has no spring between damper and joint.

    They know nothing of a callback's derivative, and on a rigid tie the damper is too stiff without it. MuJoCo's
    tendons can have a damping ``c v|v|``, which is the orifice's law: the model's tendon gets it, with the larger of
    the two coefficients, and the device's force gives it back. Their sum is exact at every evaluation.
    """
    if not parameters.tendon.rigid:
        return
    actuator = model.actuator(name).id
    shown = max(parameters.damper.concentric, parameters.damper.eccentric)
    model.tendon_dampingpoly[model.actuator_trnid[actuator, 0], 0] += shown
    model.actuator_user[actuator, SHOWN_DAMPING] = shown
