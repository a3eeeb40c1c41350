"""Source of the compiled callbacks, which read and write mjModel and mjData in place.

This module never runs as plain Python. :mod:`klute_sim.plant.compiled_callbacks` compiles a copy and fills in the
placeholders below: the offsets of MuJoCo's fields, in words of 8 bytes, and functions that exist only in compiled code.

An actuator carries a device when its ``actuator_user`` begins with :data:`LAYOUT_ID`, and the friction of a joint when
it begins with :data:`FRICTION_LAYOUT_ID`. Every other actuator gets MuJoCo's neutral values: no rates and no force.
"""

from typing import Any

import mujoco
import numpy as np
from numba import carray

from klute_sim.device.backend.packing import LAYOUT_ID
from klute_sim.device.dynamics import N_INTERNAL_STATES, ZERO_INTERNAL_STATE
from klute_sim.plant.coupling import N_ALL_STATES, N_BASE_STATES, USER_ROW_SIZE
from klute_sim.plant.joint_friction import FRICTION_LAYOUT_ID, FRICTION_ROW_SIZE, N_FRICTION_STATES

USER_DYNAMICS = int(mujoco.mjtDyn.mjDYN_USER)
"""MuJoCo's number of the dynamics type 'user'."""
PLACEHOLDER = -1
"""Value of an offset that is not filled in."""
MODEL_SIZE = DATA_SIZE = PLACEHOLDER
"""Sizes of the used parts of mjModel and mjData [words]."""
NUSER = USER = DYNTYPE = ACTNUM = ACTADR = OUTADR = CTRLADR = TRNID = DOFADR = INVWEIGHT = TIMESTEP = PLACEHOLDER
"""Offsets in mjModel [words]."""
ACT = ACT_DOT = CTRL = LENGTH = VELOCITY = TIME = PLACEHOLDER
"""Offsets in mjData [words]."""
address_to_pointer: Any = None
"""Converts an address to a pointer."""
pointer_to_address: Any = None
"""Converts a pointer to an address."""
compute_rates: Any = None
"""Compiled :func:`klute_sim.plant.coupling.compute_rates`."""
compute_force: Any = None
"""Compiled :func:`klute_sim.plant.coupling.compute_force`."""
compute_stretch_rate: Any = None
"""Compiled :func:`klute_sim.plant.joint_friction.compute_stretch_rate`."""
compute_friction_force: Any = None
"""Compiled :func:`klute_sim.plant.joint_friction.compute_friction_force`."""
to_tuple: Any = None
"""Converts the first numbers of an array to a tuple."""
record_fault: Any = None
"""Records a fault (:mod:`klute_sim.plant.compiled_callbacks`)."""


def read_int(words: Any, pointer: int, index: int) -> Any:
    """Return number ``index`` of the array of C ints to which word ``pointer`` points."""
    return carray(address_to_pointer(words[pointer] + 4 * index), (1,), np.int32)[0]


def view_doubles(words: Any, pointer: int, index: int, size: int) -> Any:
    """Return a view of ``size`` numbers from ``index`` on in the array of doubles to which word ``pointer`` points."""
    return carray(address_to_pointer(words[pointer] + 8 * index), (size,), np.float64)


def get_parameter_row(words: Any, actuator: int) -> Any:
    """Return the actuator's parameter row; empty without a device or without room for its states."""
    width = words[NUSER]
    if width >= USER_ROW_SIZE and read_int(words, DYNTYPE, actuator) == USER_DYNAMICS:
        n_states = read_int(words, ACTNUM, actuator)
        if n_states in (N_BASE_STATES, N_ALL_STATES):
            row = view_doubles(words, USER, width * actuator, USER_ROW_SIZE)
            if row[0] == LAYOUT_ID:
                return row
    return view_doubles(words, USER, 0, 0)


def get_friction_row(words: Any, actuator: int) -> Any:
    """Return the row of the joint friction on the actuator; empty without one."""
    width = words[NUSER]
    if (
        width >= FRICTION_ROW_SIZE
        and read_int(words, DYNTYPE, actuator) == USER_DYNAMICS
        and read_int(words, ACTNUM, actuator) == N_FRICTION_STATES
    ):
        row = view_doubles(words, USER, width * actuator, FRICTION_ROW_SIZE)
        if row[0] == FRICTION_LAYOUT_ID:
            return row
    return view_doubles(words, USER, 0, 0)


def get_inverse_inertia(words: Any, actuator: int) -> Any:
    """Return the inverse inertia [1/(kg m2)] of the actuator's joint while all others are free."""
    joint = read_int(words, TRNID, 2 * actuator)
    return view_doubles(words, INVWEIGHT, read_int(words, DOFADR, joint), 1)[0]


def advance_friction(m: Any, d: Any, actuator: int, dt: float) -> Any:
    """Return the rate of the state of a joint's friction; 0 for an actuator without one."""
    row = get_friction_row(m, actuator)
    if row.size == 0:
        return 0.0
    stretch = view_doubles(d, ACT, read_int(m, ACTADR, actuator), 1)[0]
    velocity = view_doubles(d, VELOCITY, read_int(m, OUTADR, actuator), 1)[0]
    return compute_stretch_rate(row, stretch, velocity, get_inverse_inertia(m, actuator), dt)


def apply_friction(m: Any, d: Any, actuator: int, dt: float) -> Any:
    """Return the force of a joint's friction; 0 for an actuator without one."""
    row = get_friction_row(m, actuator)
    if row.size == 0:
        return 0.0
    start = read_int(m, ACTADR, actuator)
    stretch, rate = view_doubles(d, ACT, start, 1)[0], view_doubles(d, ACT_DOT, start, 1)[0]
    velocity = view_doubles(d, VELOCITY, read_int(m, OUTADR, actuator), 1)[0]
    return compute_friction_force(row, stretch, rate, velocity, get_inverse_inertia(m, actuator), dt)


def read_internal_state(m: Any, d: Any, actuator: int) -> Any:
    """Return the internal state of the device; zeros if the model has no room for it."""
    if read_int(m, ACTNUM, actuator) == N_BASE_STATES:
        return ZERO_INTERNAL_STATE
    return to_tuple(
        view_doubles(d, ACT, read_int(m, ACTADR, actuator) + N_BASE_STATES, N_INTERNAL_STATES), N_INTERNAL_STATES
    )


def act_dyn(model: Any, data: Any, actuator: int) -> Any:
    """Write the rates of the device's states, or return that of a friction: ``mjcb_act_dyn``."""
    m, d = carray(model, (MODEL_SIZE,), np.int64), carray(data, (DATA_SIZE,), np.int64)
    row, dt = get_parameter_row(m, actuator), carray(model, (MODEL_SIZE,), np.float64)[TIMESTEP]
    if row.size == 0:
        return advance_friction(m, d, actuator, dt)
    start = read_int(m, ACTADR, actuator)
    internal_state = read_internal_state(m, d, actuator)
    act, act_dot = view_doubles(d, ACT, start, N_BASE_STATES), view_doubles(d, ACT_DOT, start, N_ALL_STATES)
    command = view_doubles(d, CTRL, read_int(m, CTRLADR, actuator), 1)[0]
    length = view_doubles(d, LENGTH, read_int(m, OUTADR, actuator), 1)[0]
    act_dot[0], act_dot[1], after = compute_rates(row, act[0], act[1], internal_state, command, length, dt)
    if read_int(m, ACTNUM, actuator) != N_BASE_STATES:
        for k in range(N_INTERNAL_STATES):
            act_dot[N_BASE_STATES + k] = (after[k] - internal_state[k]) / dt
    if not np.isfinite(act_dot[0]):
        time = carray(data, (DATA_SIZE,), np.float64)[TIME]
        record_fault(
            pointer_to_address(model), pointer_to_address(data), actuator, time, command, act[0], act[1], length
        )
    return 0.0


def act_bias(model: Any, data: Any, actuator: int) -> Any:
    """Return the actuator force of a device or a friction: ``mjcb_act_bias``."""
    m, d = carray(model, (MODEL_SIZE,), np.int64), carray(data, (DATA_SIZE,), np.int64)
    row, dt = get_parameter_row(m, actuator), carray(model, (MODEL_SIZE,), np.float64)[TIMESTEP]
    if row.size == 0:
        return apply_friction(m, d, actuator, dt)
    start, out = read_int(m, ACTADR, actuator), read_int(m, OUTADR, actuator)
    internal_state = read_internal_state(m, d, actuator)
    act, act_dot = view_doubles(d, ACT, start, N_BASE_STATES), view_doubles(d, ACT_DOT, start, N_BASE_STATES)
    length, velocity = view_doubles(d, LENGTH, out, 1)[0], view_doubles(d, VELOCITY, out, 1)[0]
    return compute_force(row, act[0], act[1], internal_state, act_dot[0], act_dot[1], length, velocity, dt)
