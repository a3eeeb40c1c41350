"""The foot of the prosthesis in a replay."""

from klute_sim.device.device import Device
from klute_sim.device.schema import effects
from klute_sim.effects import catalogue
from klute_sim.gait.body import read_foot
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE, build_gait_model
from klute_sim.laws.foot import Foot

MODEL_TIME_STEP = 5e-4
"""Time step of the model from which the foot is read [s]; the foot does not depend on it."""


def build_device_foot(device: Device) -> Foot:
    """Return the foot of the prosthesis with ``device``.

    The origin of the tendon is that of the gait rig: the muscle has its mounting length at a neutral ankle.

    Raises InputError when the device does not fit into the prosthesis.
    """
    return read_foot(build_gait_model(device, mass=MODEL_MASS, stature=MODEL_STATURE, dt=MODEL_TIME_STEP))


def build_bare_foot(device: Device) -> Foot:
    """Return the foot of the prosthesis with ``device`` without its effects of the body."""
    retained = {
        name: content for name, content in device.spec.effects.items() if catalogue.get_effects()[name].kind != "body"
    }
    return build_device_foot(device.with_spec(device.spec.model_copy(update={"effects": retained})))


def build_replayed_foot(device: Device) -> Foot:
    """Return the foot with all effects of the body, those included that only a replay can simulate."""
    return effects.apply_body_effects(device.spec.effects, build_bare_foot(device))
