"""The foot that a device is replayed on."""

from klute_sim.device.files import Device
from klute_sim.laws.foot import Foot
from klute_sim.rigs.gait.body import read_foot
from klute_sim.rigs.gait.build import MODEL_MASS, MODEL_STATURE, build_gait_model

MODEL_TIME_STEP = 5e-4
"""Of the model that the numbers are read from [s]; none depends on it."""


def build_device_foot(device: Device) -> Foot:
    """The foot that ``device`` is built onto; raises InputError for a device that does not fit.

    The tendon's origin is put where the gait rig puts it: with the muscle at its mounting length at a neutral ankle.
    """
    return read_foot(build_gait_model(device, mass=MODEL_MASS, stature=MODEL_STATURE, dt=MODEL_TIME_STEP))
