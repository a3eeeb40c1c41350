"""Readers and writers of motion-capture file formats; they parse the format and do not interpret channel names.

``content`` reads the bytes; ``storage`` (.mot, .sto), ``trc``, ``visual3d`` and ``c3d`` parse them; ``c3d_process``
isolates the C++ library that reads C3D, and ``force_plates`` converts the channels of its force plates.
"""
