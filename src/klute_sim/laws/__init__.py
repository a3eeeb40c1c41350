"""The source's formulas as pure scalar functions: floats in, floats out.

The modules use no state, no files, no MuJoCo and no NumPy, so that one source runs as plain Python and compiled.
Integer powers are written as products, because ``x**3`` and ``x*x*x`` differ in the last bit between CPython and
compiled code. ``pneumatic_step`` builds on ``supply_valve``, that on ``valve``, and ``valve`` on ``pneumatics``; the
other modules are independent.

Units are SI (m, N, Pa, s, kg). Pressure is gauge. Tension is positive.
"""
