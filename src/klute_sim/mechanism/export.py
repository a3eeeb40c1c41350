"""MJCF files that contain devices: MuJoCo alone loads them without force, and this package with it."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping

from klute_sim.device.device import Device
from klute_sim.mechanism.assembly import prepare_actuator
from klute_sim.plant import models
from klute_sim.plant.mjcf.model_file import ModelFile
from klute_sim.plant.mjcf.model_numbers import set_model_numbers

TEXT_PREFIX = "klute_sim_device_"
"""Beginning of the names of the texts (``<custom>``) that state the device on each tendon."""


def format_mjcf(file: ModelFile, devices: Mapping[str, Device], numbers: Mapping[str, float]) -> str:
    """Return the model ``file`` as MJCF with ``devices`` (tendon -> device) on its tendons and changed ``numbers``.

    The parameters of a device are in the attribute ``user`` of its actuator, with all digits, and its name and digest
    in a text. Raises InputError when a tendon cannot carry a device or a number is unknown.
    """
    spec = file.make_spec()
    set_model_numbers(spec, numbers)
    actuators = {prepare_actuator(spec, name): device.parameters for name, device in devices.items()}
    for name, device in devices.items():
        spec.add_text(name=f"{TEXT_PREFIX}{name}", data=f"{device.name} sha256:{device.digest}")
    models.attach_devices(spec, actuators)
    root = ElementTree.fromstring(spec.to_xml())
    for element in root.iter("general"):
        if element.get("name") in actuators:  # MuJoCo writes six digits, which are too few for the layout of the row
            row = spec.actuator(element.get("name")).userdata
            element.set("user", " ".join(format(float(value), ".17g") for value in row))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"
