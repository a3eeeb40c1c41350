"""The source's formulas as pure scalar functions: floats in, floats out.

Nothing here knows states, files or MuJoCo, and nothing uses NumPy, so that one source runs as plain
Python and under a compiler. Integer powers are written as products: ``x**3`` differs from ``x*x*x`` in
the last bit between CPython and compiled code.

Units are SI (m, N, Pa, s, kg). Pressure is gauge. Tension is positive.
"""
