"""MuJoCo models with devices on their actuators.

Order of dependence: ``coupling`` (states and forces in MuJoCo's terms), ``struct_layout`` and ``struct_access`` (fields
of MuJoCo's C structs), ``compiled_callbacks`` (C functions), ``callback_slots`` and ``callbacks`` (installation into
MuJoCo), ``models`` (MJCF files and attached devices), ``actuator`` (one device in one simulation), ``batch`` (many
simulations in parallel).
"""
