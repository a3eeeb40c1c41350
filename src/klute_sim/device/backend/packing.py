"""A device's parameters as one row of numbers.

MuJoCo carries the row in ``actuator_user``, so a model *is* its device: copies, pickles and simulations with
parameters of their own need nothing else. The row is SI; its first number says that it is one of these.
"""

from collections.abc import Sequence

from klute_sim.device.dynamics import N_EFFECT_VALUES, DeviceParameters
from klute_sim.effects import catalogue
from klute_sim.laws.damper import Damper
from klute_sim.laws.mckibben import Muscle
from klute_sim.laws.pneumatics import Supply
from klute_sim.laws.tendon import Tendon

LAYOUT_ID = 2000e6 + catalogue.layout_checksum()
"""First number of a row. A row of another layout, or with other effects, gets another signature."""
EFFECTS_OFFSET = 1 + len(Muscle._fields) + len(Damper._fields) + len(Tendon._fields) + len(Supply._fields)
"""Where the effects begin in a row."""
ROW_SIZE = EFFECTS_OFFSET + N_EFFECT_VALUES
"""Numbers in a row."""


def pack_parameters(parameters: DeviceParameters) -> tuple[float, ...]:
    """The row of ``parameters``: the signature, then every field in its order."""
    return (LAYOUT_ID, *(float(value) for part in parameters for value in part))


def unpack_parameters(row: Sequence[float]) -> DeviceParameters:
    """The parameters of a ``row``, which must begin with :data:`SIGNATURE`; the inverse of :func:`pack`."""
    # Spelled out, because a compiler has to follow it.
    return DeviceParameters(
        Muscle(row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10]),
        Damper(row[11], row[12]),
        Tendon(row[13], row[14], row[15], row[16], row[17] != 0.0),
        Supply(
            row[18],
            row[19],
            row[20],
            row[21],
            row[22],
            row[23],
            row[24],
            row[25],
            row[26],
            row[27],
            row[28],
            row[29],
            row[30],
            row[31],
            row[32],
            row[33],
            row[34],
            row[35],
        ),
        row[EFFECTS_OFFSET:ROW_SIZE],
    )
