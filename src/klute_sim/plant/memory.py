"""The callbacks as compiled code: they read and write mjModel and mjData in place.

Never run as plain Python. :mod:`klute_sim.plant.native` compiles a copy in which the names below are filled in: where
MuJoCo keeps things, in words of 8 bytes, and the functions that are only there once compiled.

An actuator is ours when its ``actuator_user`` begins with the device's signature; every other one gets what MuJoCo
gives an actuator without a callback: no rates, no force.
"""

from typing import Any

import mujoco
import numpy as np
from numba import carray

from klute_sim.device.step import MEMORY, NO_MEMORY
from klute_sim.device.vector import SIGNATURE
from klute_sim.plant.coupling import ALL_STATES, ROW, STATES

USER_DYNAMICS = int(mujoco.mjtDyn.mjDYN_USER)
UNKNOWN = -1
M_SIZE = D_SIZE = UNKNOWN
"""Words of mjModel and mjData that are looked at."""
NUSER = USER = DYNTYPE = ACTNUM = ACTADR = OUTADR = CTRLADR = TIMESTEP = UNKNOWN
"""In mjModel."""
ACT = ACT_DOT = CTRL = LENGTH = VELOCITY = TIME = UNKNOWN
"""In mjData."""
at: Any = None
"""A number as a pointer."""
address: Any = None
"""A pointer as a number."""
rates: Any = None
force: Any = None
"""Of :mod:`klute_sim.plant.coupling`."""
to_tuple: Any = None
"""The first numbers of an array as a tuple."""
report_fault: Any = None
"""Of :mod:`klute_sim.plant.native`."""


def entry(words: Any, pointer: int, index: int) -> Any:
    """Number ``index`` of the array of C ints that word ``pointer`` points to."""
    return carray(at(words[pointer] + 4 * index), (1,), np.int32)[0]


def reals(words: Any, pointer: int, index: int, count: int) -> Any:
    """``count`` numbers, from ``index`` on, of the array of doubles that word ``pointer`` points to."""
    return carray(at(words[pointer] + 8 * index), (count,), np.float64)


def row_of(words: Any, actuator: int) -> Any:
    """The actuator's row of parameters, empty if it carries no device or has no place for its states."""
    width = words[NUSER]
    if width >= ROW and entry(words, DYNTYPE, actuator) == USER_DYNAMICS:
        states = entry(words, ACTNUM, actuator)
        if states in (STATES, ALL_STATES):
            row = reals(words, USER, width * actuator, ROW)
            if row[0] == SIGNATURE:
                return row
    return reals(words, USER, 0, 0)


def remembered(m: Any, d: Any, actuator: int) -> Any:
    """What its effects remember; zeros if it has no states for that."""
    if entry(m, ACTNUM, actuator) == STATES:
        return NO_MEMORY
    return to_tuple(reals(d, ACT, entry(m, ACTADR, actuator) + STATES, MEMORY), MEMORY)


def act_dyn(model: Any, data: Any, actuator: int) -> float:
    """``mjcb_act_dyn``."""
    m, d = carray(model, (M_SIZE,), np.int64), carray(data, (D_SIZE,), np.int64)
    row = row_of(m, actuator)
    if row.size == 0:
        return 0.0
    step = carray(model, (M_SIZE,), np.float64)[TIMESTEP]
    start = entry(m, ACTADR, actuator)
    memory = remembered(m, d, actuator)
    act, rate = reals(d, ACT, start, STATES), reals(d, ACT_DOT, start, ALL_STATES)
    command = reals(d, CTRL, entry(m, CTRLADR, actuator), 1)[0]
    length = reals(d, LENGTH, entry(m, OUTADR, actuator), 1)[0]
    rate[0], rate[1], after = rates(row, act[0], act[1], memory, command, length, step)
    if entry(m, ACTNUM, actuator) != STATES:
        for k in range(MEMORY):
            rate[STATES + k] = (after[k] - memory[k]) / step
    if not np.isfinite(rate[0]):
        time = carray(data, (D_SIZE,), np.float64)[TIME]
        report_fault(address(model), address(data), actuator, time, command, act[0], act[1], length)
    return 0.0


def act_bias(model: Any, data: Any, actuator: int) -> Any:
    """``mjcb_act_bias``."""
    m, d = carray(model, (M_SIZE,), np.int64), carray(data, (D_SIZE,), np.int64)
    row = row_of(m, actuator)
    if row.size == 0:
        return 0.0
    step = carray(model, (M_SIZE,), np.float64)[TIMESTEP]
    start, out = entry(m, ACTADR, actuator), entry(m, OUTADR, actuator)
    memory = remembered(m, d, actuator)
    act, rate = reals(d, ACT, start, STATES), reals(d, ACT_DOT, start, STATES)
    length, velocity = reals(d, LENGTH, out, 1)[0], reals(d, VELOCITY, out, 1)[0]
    return force(row, act[0], act[1], memory, rate[0], rate[1], length, velocity, step)
