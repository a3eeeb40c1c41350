"""The foot that a device is replayed on."""

from klute_sim.device.device import Device
from klute_sim.gait.body import read_foot
from klute_sim.gait.rig.build import MODEL_MASS, MODEL_STATURE, build_gait_model
from klute_sim.laws.foot import Foot

MODEL_TIME_STEP = 5e-4
"""Of the model that the numbers are read from [s]; none depends on it."""


def build_device_foot(device: Device) -> Foot:
    """The foot that ``device`` is built onto; raises InputError for a device that does not fit.

    The tendon's origin is put where the gait rig puts it: with the muscle at its mounting length at a neutral ankle.
    """
    return read_foot(build_gait_model(device, mass=MODEL_MASS, stature=MODEL_STATURE, dt=MODEL_TIME_STEP))
