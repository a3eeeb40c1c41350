"""Pack the parameters of a device into one row of numbers, and unpack them.

MuJoCo carries the row in ``actuator_user``. A model therefore contains its device: copies, pickles and simulations with
changed parameters need nothing else. All numbers are in SI units. The first number identifies the layout of the row.
"""

from collections.abc import Sequence
from itertools import chain

from klute_sim.device.dynamics import N_EFFECT_VALUES, DeviceParameters
from klute_sim.effects import catalogue
from klute_sim.laws.damper import DamperParameters
from klute_sim.laws.mckibben import MuscleParameters
from klute_sim.laws.pneumatics import SupplyParameters
from klute_sim.laws.tendon import TendonParameters

LAYOUT_ID = 2003e6 + catalogue.compute_layout_checksum()
"""First number of a row; a row with another layout or other effects has another number."""
EFFECTS_OFFSET = (
    1
    + len(MuscleParameters._fields)
    + len(DamperParameters._fields)
    + len(TendonParameters._fields)
    + len(SupplyParameters._fields)
)
"""Index of the first effect value in a row."""
ROW_SIZE = EFFECTS_OFFSET + N_EFFECT_VALUES
"""Length of a row."""


def pack_parameters(parameters: DeviceParameters) -> tuple[float, ...]:
    """Return the row of ``parameters``: the layout number, then all fields in their order."""
    return (LAYOUT_ID, *map(float, chain.from_iterable(parameters)))


def unpack_parameters(row: Sequence[float]) -> DeviceParameters:
    """Return the parameters in ``row``, which must begin with :data:`LAYOUT_ID`.

    This is the inverse of :func:`pack_parameters`.
    """
    # The fields are spelled out because numba cannot build a named tuple from a slice of an array.
    return DeviceParameters(
        MuscleParameters(row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10]),
        DamperParameters(row[11], row[12], row[13], row[14], row[15], row[16], row[17]),
        TendonParameters(row[18], row[19], row[20], row[21], row[22] != 0.0),
        SupplyParameters(
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
            row[36],
            row[37],
            row[38],
            row[39],
            row[40],
            row[41],
        ),
        row[EFFECTS_OFFSET:ROW_SIZE],
    )
