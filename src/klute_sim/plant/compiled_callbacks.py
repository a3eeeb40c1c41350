"""The compiled installation: C functions for MuJoCo's slots that take no lock of Python's.

A C function cannot raise. A device without a finite state is reported to :data:`faults`, in the thread that steps it;
its pressure becomes NaN, and the device itself gives no force from then on, so that the bodies stay where they can be
looked at.
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
from klute_sim.plant import coupling, struct_access
from klute_sim.plant.struct_layout import get_layout, read_actuator_name


class Fault(NamedTuple):
    """A device without a finite state."""

    actuator: str
    """Its name."""
    time: float
    """[s]"""
    command: float
    """[bar]"""
    pressure: float
    """[bar]"""
    offset: float
    """Muscle length minus resting length [m]."""
    unit_length: float
    """[m]"""


pending_faults: dict[int, dict[tuple[int, int], Fault]] = {}
"""Thread -> (address of mjData, actuator) -> the first report of it that nobody has taken yet."""


def pop_fault(data_address: int | None = None) -> Fault | None:
    """The calling thread's first report (about the mjData at that address), which is then forgotten with its like."""
    mine = pending_faults.get(threading.get_ident(), {})
    concerned = [place for place in mine if data_address in (None, place[0])]
    taken = [mine.pop(place) for place in concerned]
    if not mine:
        pending_faults.pop(threading.get_ident(), None)
    return taken[0] if taken else None


class Callbacks(NamedTuple):
    """What goes into the slots; keep it as long as it is in there."""

    act_dyn: Any
    act_bias: Any


def _record_fault(model_address: int, data_address: int, actuator: int, *values: float) -> float:
    mine = pending_faults.setdefault(threading.get_ident(), {})
    if (data_address, actuator) not in mine:  # a device that has failed fails at every step
        mine[data_address, actuator] = Fault(read_actuator_name(model_address, get_layout(), actuator), *values)
    return 0.0


_REPORT_TYPE = ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_int64] * 3, *[ctypes.c_double] * 5)
_record_fault_pointer = _REPORT_TYPE(_record_fault)


_REPORT_SYMBOL = "klute_sim_report_fault"
"""Name under which compiled code finds :func:`_report`: its address differs from process to process."""
llvmlite.binding.add_symbol(_REPORT_SYMBOL, ctypes.cast(_record_fault_pointer, ctypes.c_void_p).value)


def _number_to_pointer(typing: Any, number: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.inttoptr(arguments[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), generate


def _pointer_to_number(typing: Any, pointer: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.ptrtoint(arguments[0], context.get_value_type(types.int64))

    return types.int64(types.voidptr), generate


@cache
def get_callbacks() -> Callbacks:
    """Compile, or take from the disk; raises UnknownLayoutError when MuJoCo's memory is not understood."""
    where = get_layout()
    m = {name: offset // 8 for name, offset in where.model.items()}
    d = {name: offset // 8 for name, offset in where.data.items()}
    words = {
        "M_SIZE": max(m.values()) + 1,
        "D_SIZE": max(d.values()) + 1,
        "NUSER": m["nuser_actuator"],
        "DYNTYPE": m["actuator_dyntype"],
        "ACTNUM": m["actuator_actnum"],
        "USER": m["actuator_user"],
        "ACTADR": m["actuator_actadr"],
        "OUTADR": m["actuator_outadr"],
        "CTRLADR": m["actuator_ctrladr"],
        "TIMESTEP": m["timestep"],
        "ACT": d["act"],
        "ACT_DOT": d["act_dot"],
        "CTRL": d["ctrl"],
        "LENGTH": d["actuator_length"],
        "VELOCITY": d["actuator_velocity"],
        "TIME": d["time"],
    }
    device = compile_module(coupling, **compile_device_functions())
    report = types.ExternalFunction(_REPORT_SYMBOL, types.float64(*[types.int64] * 3, *[types.float64] * 5))
    pointers = {"at": intrinsic(_number_to_pointer), "address": intrinsic(_pointer_to_number)}
    filled = {
        **pointers,
        "rates": device.compute_rates,
        "force": device.compute_force,
        "report_fault": report,
        "to_tuple": to_fixed_tuple,
    }
    code = compile_module(struct_access, **words, **filled)
    signature, constants = (
        types.float64(types.voidptr, types.voidptr, types.intc),
        repr((sorted(words.items()), struct_access.USER_DYNAMICS)),
    )
    made = Callbacks(*(compile_cached(numba.cfunc, f, signature, constants) for f in (code.act_dyn, code.act_bias)))
    for function in made:
        function.ctypes.argtypes = (_StructArgument, _StructArgument, ctypes.c_int)
    return made


class _StructArgument:
    """Lets Python call what is in the slots, as it may call Python callbacks: with an MjModel and an MjData."""

    @staticmethod
    def from_param(owner: Any) -> ctypes.c_void_p:
        return ctypes.c_void_p(owner._address)
