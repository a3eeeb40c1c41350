"""Memory layout of mjModel and mjData: byte offsets of their fields in the installed version of MuJoCo.

MuJoCo describes its own structs (``mujoco.introspect``). The offsets follow from that description by the rules of a C
compiler, and are then checked against a live model.
"""

import ctypes
from functools import cache
from typing import Any, NamedTuple

import mujoco

MODEL_POINTERS = (
    "actuator_user",
    "actuator_dyntype",
    "actuator_actnum",
    "actuator_actadr",
    "actuator_outadr",
    "actuator_ctrladr",
    "actuator_trnid",
    "jnt_dofadr",
    "dof_invweight0",
    "name_actuatoradr",
)
"""Array fields of mjModel that the callbacks use."""
DATA_POINTERS = ("act", "act_dot", "ctrl", "actuator_length", "actuator_velocity")
"""Array fields of mjData that the callbacks use."""

_BASIC_TYPES: dict[str, Any] = {
    "int": ctypes.c_int,
    "unsigned int": ctypes.c_uint,
    "char": ctypes.c_char,
    "unsigned char": ctypes.c_ubyte,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_size_t,
    "int64_t": ctypes.c_int64,
    "uint64_t": ctypes.c_uint64,
    "uint32_t": ctypes.c_uint32,
    "mjtNum": ctypes.c_double,
    "mjtByte": ctypes.c_ubyte,
    "mjtBool": ctypes.c_bool,
    "mjtSize": ctypes.c_int64,
}

_PROBE_XML = """
<mujoco>
  <worldbody><body><joint name="j" type="slide"/><geom size=".1"/></body></worldbody>
  <actuator>
    <motor joint="j" user="1"/>
    <general name="second" joint="j" dyntype="integrator" user="3"/>
  </actuator>
</mujoco>"""


class UnknownLayoutError(Exception):
    """The structs of the installed MuJoCo differ from its description, or the description cannot be read."""


class StructLayout(NamedTuple):
    """Byte offsets of struct fields."""

    model: dict[str, int]
    """Offsets of :data:`MODEL_POINTERS`, ``nuser_actuator``, ``names`` and ``timestep`` in mjModel."""
    data: dict[str, int]
    """Offsets of :data:`DATA_POINTERS` and ``time`` in mjData."""


@cache
def get_layout() -> StructLayout:
    """Return the offsets in the installed MuJoCo.

    Raises UnknownLayoutError when they cannot be determined or are wrong.
    """
    try:
        model, data = _make_struct("mjModel"), _make_struct("mjData")
        struct_layout = StructLayout(
            {name: getattr(model, name).offset for name in (*MODEL_POINTERS, "nuser_actuator", "names")},
            {name: getattr(data, name).offset for name in (*DATA_POINTERS, "time")},
        )
        struct_layout.model["timestep"] = model.opt.offset + _make_struct("mjOption").timestep.offset
    except (ImportError, AttributeError, KeyError, TypeError) as error:
        raise UnknownLayoutError(
            f"MuJoCo {mujoco.__version__} has an unknown description of its structs: {error}"
        ) from None
    _check_layout(struct_layout)
    return struct_layout


def _check_layout(struct_layout: StructLayout) -> None:
    """Compare ``struct_layout`` with a live model; raises UnknownLayoutError that names the wrong fields."""
    model = mujoco.MjModel.from_xml_string(_PROBE_XML)
    data = mujoco.MjData(model)
    model.opt.timestep, data.time = 0.00123, 4.56
    pointer, number, real = ctypes.c_uint64.from_address, ctypes.c_int64.from_address, ctypes.c_double.from_address
    wrong = [
        name
        for owner, offsets, names in (
            (model, struct_layout.model, MODEL_POINTERS),
            (data, struct_layout.data, DATA_POINTERS),
        )
        for name in names
        if pointer(owner._address + offsets[name]).value != getattr(owner, name).__array_interface__["data"][0]
    ]
    if number(model._address + struct_layout.model["nuser_actuator"]).value != model.nuser_actuator:
        wrong.append("nuser_actuator")
    if real(model._address + struct_layout.model["timestep"]).value != model.opt.timestep:
        wrong.append("timestep")
    if real(data._address + struct_layout.data["time"]).value != data.time:
        wrong.append("time")
    if not wrong and read_actuator_name(model._address, struct_layout, 1) != "second":
        wrong.append("names")
    if any(offset % 8 for offset in (*struct_layout.model.values(), *struct_layout.data.values())):
        wrong.append("alignment")
    if wrong:
        raise UnknownLayoutError(
            f"MuJoCo {mujoco.__version__} stores {', '.join(wrong)} at other offsets than it describes"
        )


def read_actuator_name(model_address: int, offsets: StructLayout, actuator: int) -> str:
    """Return the name of an actuator of the mjModel at address ``model_address``."""
    pointer, number = ctypes.c_uint64.from_address, ctypes.c_int.from_address
    start = number(pointer(model_address + offsets.model["name_actuatoradr"]).value + 4 * actuator).value
    return ctypes.string_at(pointer(model_address + offsets.model["names"]).value + start).decode(errors="replace")


@cache
def _make_struct(name: str) -> Any:
    """Return the struct ``name`` as a ctypes class."""
    from mujoco.introspect import structs

    fields = []
    for number, declared in enumerate(structs.STRUCTS[name].fields):
        label = getattr(declared, "name", f"_{number}")
        fields.append((label, _to_ctype(getattr(declared, "type", declared))))
    return type(name, (ctypes.Structure,), {"_fields_": fields})


def _to_ctype(declared: Any) -> Any:
    """Return the ctypes counterpart of a declared C type."""
    from mujoco.introspect import ast_nodes, structs

    if isinstance(declared, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(declared, ast_nodes.ArrayType):
        element = _to_ctype(declared.inner_type)
        for extent in reversed(declared.extents):
            element = element * extent
        return element
    if isinstance(declared, ast_nodes.ValueType):
        name = declared.name.removeprefix("struct ").strip()
        if name in _BASIC_TYPES:
            return _BASIC_TYPES[name]
        for known in (name, name.rstrip("_")):
            if known in structs.STRUCTS:
                return _make_struct(known)
        if name.startswith("mjt"):  # an enumeration
            return ctypes.c_int
        raise KeyError(name)
    if isinstance(declared, ast_nodes.AnonymousStructDecl | ast_nodes.AnonymousUnionDecl):
        union = isinstance(declared, ast_nodes.AnonymousUnionDecl)
        inner = [(field.name, _to_ctype(field.type)) for field in declared.fields]
        return type("anonymous", (ctypes.Union if union else ctypes.Structure,), {"_fields_": inner})
    raise TypeError(f"unknown kind of C type: {type(declared).__name__}")
