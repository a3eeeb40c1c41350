"""Roll-over shape of the foot: the path of the centre of pressure in the frame of the shank."""

import numpy as np

from klute_sim.recording.recording import Recording

ROLLOVER_END_PCT = 50.0
"""Gait phase [%] of the opposite heel strike, where the roll-over shape ends (Hansen & Meier 2010)."""


def fit_rollover_radius(stride: Recording, loaded: np.ndarray) -> float | None:
    """Return the radius [m] of the circle through the centre of pressure in the frame of the shank (Kasa's fit)."""
    used = loaded & np.isfinite(stride["cop_x"])
    if used.sum() < 10:
        return None
    tilt = np.radians(stride["shank_angle"][used])
    x, z = stride["cop_x"][used] - stride["ankle_x"][used], -stride["ankle_z"][used]
    along, up = np.cos(tilt) * x - np.sin(tilt) * z, np.sin(tilt) * x + np.cos(tilt) * z
    matrix = np.column_stack([along, up, np.ones_like(along)])
    (a, b, c), _, rank, _ = np.linalg.lstsq(matrix, along * along + up * up, rcond=None)
    square = c + 0.25 * (a * a + b * b)
    return float(np.sqrt(square)) if rank == 3 and square > 0.0 else None
