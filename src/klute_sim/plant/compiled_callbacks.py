"""The compiled callbacks: C functions for MuJoCo that do not take Python's global lock.

A C function cannot raise. It records a device without a finite state in :data:`pending_faults`, in the thread that
steps the device. The device's pressure becomes NaN, and the device gives no force from then on, so that the state of
the bodies can still be inspected.
"""

import ctypes
import threading
from functools import cache
from typing import Any, NamedTuple

import llvmlite.binding
import numba
from numba import types
from numba.extending import intrinsic
from numba.np.unsafe.ndarray import to_fixed_tuple

from klute_sim.device.backend.compiled import compile_cached, compile_device_functions, compile_module
from klute_sim.plant import coupling, joint_friction, struct_access
from klute_sim.plant.struct_layout import get_layout, read_actuator_name


class Fault(NamedTuple):
    """A device without a finite state."""

    actuator: str
    """Name of the actuator."""
    time: float
    """Time of the step [s]."""
    command: float
    """Command [bar], or valve opening [1]."""
    pressure: float
    """Gauge pressure before the step [bar]."""
    offset: float
    """Muscle length minus resting length [m]."""
    unit_length: float
    """Length of the muscle-tendon unit [m]."""


pending_faults: dict[int, dict[tuple[int, int], Fault]] = {}
"""First fault that has not been reported yet, by thread and then by (address of mjData, actuator)."""


def pop_fault(data_address: int | None = None) -> Fault | None:
    """Return the first fault of the calling thread and clear its faults; None without one.

    With ``data_address`` only faults of the mjData at that address are considered.
    """
    thread_faults = pending_faults.get(threading.get_ident(), {})
    keys = [key for key in thread_faults if data_address in (None, key[0])]
    popped = [thread_faults.pop(key) for key in keys]
    if not thread_faults:
        pending_faults.pop(threading.get_ident(), None)
    return popped[0] if popped else None


class Callbacks(NamedTuple):
    """C functions for MuJoCo's slots; keep a reference while they are installed."""

    act_dyn: Any
    """Function for ``mjcb_act_dyn``."""
    act_bias: Any
    """Function for ``mjcb_act_bias``."""
    time: Any
    """Function for ``mjcb_time`` that reads no clock."""


def _record_fault(model_address: int, data_address: int, actuator: int, *values: float) -> float:
    thread_faults = pending_faults.setdefault(threading.get_ident(), {})
    if (data_address, actuator) not in thread_faults:  # a failed device fails again at every step
        name = read_actuator_name(model_address, get_layout(), actuator)
        thread_faults[data_address, actuator] = Fault(name, *values)
    return 0.0


_RECORD_FAULT_TYPE = ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_int64] * 3, *[ctypes.c_double] * 5)
_record_fault_pointer = _RECORD_FAULT_TYPE(_record_fault)


_RECORD_FAULT_SYMBOL = "klute_sim_record_fault"
"""Symbol of :func:`_record_fault` in compiled code, whose address differs from process to process."""
llvmlite.binding.add_symbol(_RECORD_FAULT_SYMBOL, ctypes.cast(_record_fault_pointer, ctypes.c_void_p).value)


def _address_to_pointer(typing: Any, address: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), generate


def _pointer_to_address(typing: Any, pointer: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ptrtoint(arguments[0], context.get_value_type(types.int64))

    return types.int64(types.voidptr), generate


def _skip_clock() -> float:
    return 0.0


@cache
def get_callbacks() -> Callbacks:
    """Return the callbacks, compiled or loaded from the cache on disk.

    Raises UnknownLayoutError when the layout of MuJoCo's structs is unknown.
    """
    layout = get_layout()
    m = {name: offset // 8 for name, offset in layout.model.items()}
    d = {name: offset // 8 for name, offset in layout.data.items()}
    offsets = {
        "MODEL_SIZE": max(m.values()) + 1,
        "DATA_SIZE": max(d.values()) + 1,
        "NUSER": m["nuser_actuator"],
        "DYNTYPE": m["actuator_dyntype"],
        "ACTNUM": m["actuator_actnum"],
        "USER": m["actuator_user"],
        "ACTADR": m["actuator_actadr"],
        "OUTADR": m["actuator_outadr"],
        "CTRLADR": m["actuator_ctrladr"],
        "TRNID": m["actuator_trnid"],
        "DOFADR": m["jnt_dofadr"],
        "INVWEIGHT": m["dof_invweight0"],
        "TIMESTEP": m["timestep"],
        "ACT": d["act"],
        "ACT_DOT": d["act_dot"],
        "CTRL": d["ctrl"],
        "LENGTH": d["actuator_length"],
        "VELOCITY": d["actuator_velocity"],
        "TIME": d["time"],
    }
    compiled_coupling = compile_module(coupling, **compile_device_functions())
    compiled_friction = compile_module(joint_friction)
    functions = {
        "address_to_pointer": intrinsic(_address_to_pointer),
        "pointer_to_address": intrinsic(_pointer_to_address),
        "compute_rates": compiled_coupling.compute_rates,
        "compute_force": compiled_coupling.compute_force,
        "compute_stretch_rate": compiled_friction.compute_stretch_rate,
        "compute_friction_force": compiled_friction.compute_friction_force,
        "record_fault": types.ExternalFunction(
            _RECORD_FAULT_SYMBOL, types.float64(*[types.int64] * 3, *[types.float64] * 5)
        ),
        "to_tuple": to_fixed_tuple,
    }
    code = compile_module(struct_access, makes_arrays=True, **offsets, **functions)
    signature = types.float64(types.voidptr, types.voidptr, types.intc)
    constants = repr((sorted(offsets.items()), struct_access.USER_DYNAMICS))
    act_dyn, act_bias = (
        compile_cached(numba.cfunc, function, signature, constants, makes_arrays=True)
        for function in (code.act_dyn, code.act_bias)
    )
    for callback in (act_dyn, act_bias):
        callback.ctypes.argtypes = (_StructArgument, _StructArgument, ctypes.c_int)
    return Callbacks(act_dyn, act_bias, numba.cfunc(types.float64())(_skip_clock))


class _StructArgument:
    """Lets Python call the C functions with an MjModel and an MjData, like Python callbacks."""

    @staticmethod
    def from_param(owner: Any) -> ctypes.c_void_p:
        return ctypes.c_void_p(owner._address)
