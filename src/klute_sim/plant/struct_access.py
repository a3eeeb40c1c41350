"""The callbacks as compiled code: they read and write mjModel and mjData in place.

Never run as plain Python. :mod:`klute_sim.plant.compiled_callbacks` compiles a copy in which the names below are filled in: where
MuJoCo keeps things, in words of 8 bytes, and the functions that are only there once compiled.

An actuator is ours when its ``actuator_user`` begins with the device's signature; every other one gets what MuJoCo
gives an actuator without a callback: no rates, no force.
"""

from typing import Any

import mujoco
import numpy as np
from numba import carray

from klute_sim.device.backend.packing import LAYOUT_ID
from klute_sim.device.dynamics import N_INTERNAL_STATES, ZERO_INTERNAL_STATE
from klute_sim.plant.coupling import N_ALL_STATES, N_BASE_STATES, USER_ROW_SIZE

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
"""Of :mod:`klute_sim.plant.compiled_callbacks`."""


def read_int(words: Any, pointer: int, index: int) -> Any:
    """Number ``index`` of the array of C ints that word ``pointer`` points to."""
    return carray(at(words[pointer] + 4 * index), (1,), np.int32)[0]


def view_doubles(words: Any, pointer: int, index: int, size: int) -> Any:
    """``count`` numbers, from ``index`` on, of the array of doubles that word ``pointer`` points to."""
    return carray(at(words[pointer] + 8 * index), (size,), np.float64)


def get_parameter_row(words: Any, actuator: int) -> Any:
    """The actuator's row of parameters, empty if it carries no device or has no place for its states."""
    width = words[NUSER]
    if width >= USER_ROW_SIZE and read_int(words, DYNTYPE, actuator) == USER_DYNAMICS:
        states = read_int(words, ACTNUM, actuator)
        if states in (N_BASE_STATES, N_ALL_STATES):
            row = view_doubles(words, USER, width * actuator, USER_ROW_SIZE)
            if row[0] == LAYOUT_ID:
                return row
    return view_doubles(words, USER, 0, 0)


def read_internal_state(m: Any, d: Any, actuator: int) -> Any:
    """What its effects remember; zeros if it has no states for that."""
    if read_int(m, ACTNUM, actuator) == N_BASE_STATES:
        return ZERO_INTERNAL_STATE
    return to_tuple(
        view_doubles(d, ACT, read_int(m, ACTADR, actuator) + N_BASE_STATES, N_INTERNAL_STATES), N_INTERNAL_STATES
    )


def act_dyn(model: Any, data: Any, actuator: int) -> float:
    """``mjcb_act_dyn``."""
    m, d = carray(model, (M_SIZE,), np.int64), carray(data, (D_SIZE,), np.int64)
    row = get_parameter_row(m, actuator)
    if row.size == 0:
        return 0.0
    step = carray(model, (M_SIZE,), np.float64)[TIMESTEP]
    start = read_int(m, ACTADR, actuator)
    memory = read_internal_state(m, d, actuator)
    act, rate = view_doubles(d, ACT, start, N_BASE_STATES), view_doubles(d, ACT_DOT, start, N_ALL_STATES)
    command = view_doubles(d, CTRL, read_int(m, CTRLADR, actuator), 1)[0]
    length = view_doubles(d, LENGTH, read_int(m, OUTADR, actuator), 1)[0]
    rate[0], rate[1], after = rates(row, act[0], act[1], memory, command, length, step)
    if read_int(m, ACTNUM, actuator) != N_BASE_STATES:
        for k in range(N_INTERNAL_STATES):
            rate[N_BASE_STATES + k] = (after[k] - memory[k]) / step
    if not np.isfinite(rate[0]):
        time = carray(data, (D_SIZE,), np.float64)[TIME]
        report_fault(address(model), address(data), actuator, time, command, act[0], act[1], length)
    return 0.0


def act_bias(model: Any, data: Any, actuator: int) -> Any:
    """``mjcb_act_bias``."""
    m, d = carray(model, (M_SIZE,), np.int64), carray(data, (D_SIZE,), np.int64)
    row = get_parameter_row(m, actuator)
    if row.size == 0:
        return 0.0
    step = carray(model, (M_SIZE,), np.float64)[TIMESTEP]
    start, out = read_int(m, ACTADR, actuator), read_int(m, OUTADR, actuator)
    memory = read_internal_state(m, d, actuator)
    act, rate = view_doubles(d, ACT, start, N_BASE_STATES), view_doubles(d, ACT_DOT, start, N_BASE_STATES)
    length, velocity = view_doubles(d, LENGTH, out, 1)[0], view_doubles(d, VELOCITY, out, 1)[0]
    return force(row, act[0], act[1], memory, rate[0], rate[1], length, velocity, step)
