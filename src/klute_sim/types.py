"""Types that every package shares."""

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
"""Array of float64 numbers; the docstring of each use gives its shape and unit."""

ComplexArray: TypeAlias = NDArray[np.complex128]
"""Array of complex128 numbers."""

Mask: TypeAlias = NDArray[np.bool_]
"""Array of booleans that selects elements of another array."""

ProgressCallback: TypeAlias = Callable[[float, str], None]
"""Receives the completed fraction (0 to 1) and a short description of the current stage."""
