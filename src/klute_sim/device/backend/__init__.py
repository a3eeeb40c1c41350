"""The two backends of a device, compiled and plain Python: ``packing``, ``compiled`` and ``select``.

``packing`` turns parameters into rows of numbers, ``compiled`` compiles the same source, ``select`` chooses a backend.
"""
