"""Channels of a mechanism: their names state the quantity and the object of the MJCF model that they belong to.

A name is ``<quantity>_<object>``, such as ``angle_elbow`` or ``pressure_command_biceps``. The object is the name of a
joint, device, site or sensor, in small letters and with ``_`` for other characters. The quantity decides the kind of
object, the unit, and whether the channel can be prescribed, measured or both.
"""

import re
from collections.abc import Iterable
from itertools import chain, count
from typing import Literal, NamedTuple

from klute_sim.errors import InputError

ObjectKind = Literal["hinge joint", "slide joint", "device", "site", "sensor"]
"""Kind of object in the model that a channel belongs to."""


class Quantity(NamedTuple):
    """A quantity that a channel of a mechanism can hold."""

    object_kind: ObjectKind
    """Kind of the object."""
    si_unit: str
    """SI unit."""
    is_input: bool
    """Whether it can be prescribed."""
    is_output: bool
    """Whether it can be measured."""


QUANTITIES = {
    "pressure_command": Quantity("device", "Pa", is_input=True, is_output=False),
    "pressure": Quantity("device", "Pa", is_input=True, is_output=True),
    "force": Quantity("device", "N", is_input=False, is_output=True),
    "muscle_length": Quantity("device", "m", is_input=False, is_output=True),
    "unit_length": Quantity("device", "m", is_input=False, is_output=True),
    "angle": Quantity("hinge joint", "rad", is_input=True, is_output=True),
    "position": Quantity("slide joint", "m", is_input=True, is_output=True),
    "moment": Quantity("hinge joint", "N*m", is_input=False, is_output=True),
    "external_moment": Quantity("hinge joint", "N*m", is_input=True, is_output=False),
    "external_force": Quantity("slide joint", "N", is_input=True, is_output=False),
    **{f"site_{axis}": Quantity("site", "m", is_input=False, is_output=True) for axis in "xyz"},
    "sensor_force": Quantity("sensor", "N", is_input=False, is_output=True),
    "sensor_moment": Quantity("sensor", "N*m", is_input=False, is_output=True),
    "sensor_angle": Quantity("sensor", "rad", is_input=False, is_output=True),
    "sensor_position": Quantity("sensor", "m", is_input=False, is_output=True),
}
"""Quantity -> what it is. ``moment`` is that of all actuators about the joint, without external moments."""
DISPLAY_UNITS = {"Pa": "bar", "N": "N", "m": "mm", "rad": "deg", "N*m": "N*m"}
"""SI unit of a channel -> unit for display."""
MAX_CHANNELS = 100
"""Largest number of channels of a mechanism."""


class Channel(NamedTuple):
    """A channel of a mechanism."""

    name: str
    """Name, ``<quantity>_<object>``."""
    quantity: str
    """Key of :data:`QUANTITIES`."""
    object_name: str
    """Name of the object as :func:`normalize_name` returns it."""

    @property
    def si_unit(self) -> str:
        """SI unit of the channel."""
        return QUANTITIES[self.quantity].si_unit

    @property
    def display_heading(self) -> str:
        """Heading of the channel in its unit for display, such as ``angle_elbow [deg]``."""
        return f"{self.name} [{DISPLAY_UNITS[self.si_unit]}]"


def normalize_name(name: str) -> str:
    """Return the ``name`` of an object as it stands in a channel: small letters, and ``_`` for other characters."""
    return re.sub(r"\W", "_", name.lower(), flags=re.ASCII)


def name_files(names: Iterable[str]) -> dict[str, str]:
    """Return name of an object -> name of its file without ending: as in a channel, with a number if it is taken."""
    stems: dict[str, str] = {}
    for name in names:
        stem, taken = normalize_name(name), set(stems.values())
        numbered = chain([stem], (f"{stem}_{number}" for number in count(2)))
        stems[name] = next(option for option in numbered if option not in taken)
    return stems


def parse_channel(name: str) -> Channel:
    """Return the channel called ``name``; raises InputError unless it begins with a quantity and names an object."""
    for quantity in sorted(QUANTITIES, key=len, reverse=True):  # pressure_command_x is no pressure of command_x
        object_name = name.removeprefix(f"{quantity}_")
        if object_name not in (name, "") and object_name == normalize_name(object_name):
            return Channel(name, quantity, object_name)
    raise InputError(
        f"the channel '{name}' is not of the form <quantity>_<object>, such as 'angle_elbow'; allowed quantities: "
        f"{', '.join(QUANTITIES)}"
    )


def parse_input_channel(name: str) -> Channel:
    """Return the channel called ``name``; raises InputError unless it can be prescribed."""
    channel = parse_channel(name)
    if not QUANTITIES[channel.quantity].is_input:
        inputs = ", ".join(name for name, quantity in QUANTITIES.items() if quantity.is_input)
        raise InputError(f"the channel '{name}' cannot be prescribed; allowed: {inputs}")
    return channel


def parse_output_channel(name: str) -> Channel:
    """Return the channel called ``name``; raises InputError unless it can be measured."""
    channel = parse_channel(name)
    if not QUANTITIES[channel.quantity].is_output:
        outputs = ", ".join(name for name, quantity in QUANTITIES.items() if quantity.is_output)
        raise InputError(f"the channel '{name}' cannot be measured; allowed: {outputs}")
    return channel
