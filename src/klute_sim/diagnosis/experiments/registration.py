"""Registration of instruments: how their coordinates and clocks fit together, on a walk above all.

A force plate, markers and a prosthesis are three systems of coordinates, each known to a few millimetres, and two
clocks. Small errors between them move the moment about the ankle in every stride alike, so they are fitted with their
usual size as a prior before any effect is named. So is the delay of a command's log on any rig, where the pressures
show one of up to about a sampling interval (:mod:`klute_sim.diagnosis.command_delay`).
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from klute_sim.gait.replay.rollout import ReplayInputs
from klute_sim.types import Array

REGISTRATION_PREFIX = "registration."
"""Beginning of the names of registration numbers among fitted parameters."""


class Registration(NamedTuple):
    """Corrections of the registration in SI units; 0 where the set-up is right.

    Each is added to what was measured, except three: the zero is subtracted from the angle, and the delays from the
    times of the plate and of the command.
    """

    cop_to_ankle: float = 0.0
    """Forward distance from ankle axis to centre of pressure [m]."""
    ankle_height: float = 0.0
    """Height of the ankle axis [m]."""
    plate_gain: float = 0.0
    """Relative correction of all forces of the plate."""
    ankle_zero: float = 0.0
    """Measured angle of a neutral ankle [rad]: the error of the angle's zero, or of the shank inclination in it."""
    plate_delay: float = 0.0
    """Time by which the plate is late against motion and device [s]."""
    command_delay: float = 0.0
    """Time by which the log of the pressure command is late against motion and device [s]."""


NO_REGISTRATION_ERROR = Registration()

PLATE_GAIN = "registration.plate_gain_pct"
"""Name of the number that multiplies the mechanical input, with its noise."""
REGISTRATION_DEVIATIONS = {
    "registration.cop_to_ankle_mm": 5.8,
    "registration.ankle_height_mm": 5.0,
    PLATE_GAIN: 1.0,
    "registration.ankle_zero_deg": 1.0,
    "registration.plate_delay_ms": 5.0,
}
"""Name -> standard deviation in the unit of the name (assumed: centre of pressure 3 mm and ankle axis 5 mm, of which
only the distance matters; plate 1 %; shank 1 degree; clocks one sample of a log at 200 Hz). In the order of
:class:`Registration`, whose last number is not in every fit."""
COMMAND_DELAY = "registration.command_delay_ms"
"""Name of the number that shifts the command in time."""
SI_FACTORS = dict(
    zip((*REGISTRATION_DEVIATIONS, COMMAND_DELAY), (1e-3, 1e-3, 1e-2, np.pi / 180.0, 1e-3, 1e-3), strict=True)
)
"""Name -> its unit in SI, in the order of :class:`Registration`."""


def make_registration(corrections: Iterable[tuple[str, float]]) -> tuple[float, ...]:
    """Return the fields of the :class:`Registration` with these (name, value in the unit of the name).

    Returns an empty tuple without any.
    """
    values = dict(corrections)
    return tuple(values.get(name, 0.0) * factor for name, factor in SI_FACTORS.items()) if values else ()


SMOOTHING_TIME = 2e-3
"""Standard deviation [s] of the Gaussian filter that tells the load from the noise of the plate (assumed: it passes
99 % at 10 Hz, and a seventh of the variance of white noise at 1 kHz)."""


class PlateLoad(NamedTuple):
    """What a correction of the plate needs beside the inputs of a replay, one value per time step each."""

    vertical: Array
    """Vertical ground reaction [N]."""
    ankle_x: Array
    """Forward position of the ankle [m]."""
    ankle_z: Array
    """Height of the ankle [m]."""

    def map(self, change: Callable[[Array], Array]) -> "PlateLoad":
        """Return the load with all series after ``change``."""
        return PlateLoad(*(change(series) for series in self))


class MeasuredInputs:
    """Inputs of a replay as they were measured, one value per time step, which any registration corrects.

    The moment of the ground reaction about the ankle, plantarflexion positive, is ``-z F_forward - d F_vertical`` with
    height z of the ankle and distance d of the centre of pressure in front of it.
    """

    def __init__(self, inputs: ReplayInputs, load: PlateLoad, dt: float) -> None:
        """Take ``inputs`` and ``load`` with a time step ``dt`` [s]."""
        self._inputs, self._load, self._dt = inputs, load, dt
        self._sine, self._cosine = np.sin(inputs.shank_angle), np.cos(inputs.shank_angle)
        self._forward = self._sine * inputs.axial_force - self._cosine * inputs.shear_force

    def correct(self, registration: Registration) -> ReplayInputs:
        """Return the inputs under the errors of ``registration``, but for the delay of the command."""
        inputs, load, gain = self._inputs, self._load, 1.0 + registration.plate_gain
        forward, vertical = self._forward, load.vertical
        if registration.plate_delay != 0.0:
            forward, vertical, moment_about_origin = self._advance_plate(registration.plate_delay)
            inputs = inputs._replace(
                ground_moment=load.ankle_x * vertical - load.ankle_z * forward - moment_about_origin,
                axial_force=self._cosine * vertical + self._sine * forward,
                shear_force=self._sine * vertical - self._cosine * forward,
            )
        shift = registration.ankle_height * forward + registration.cop_to_ankle * vertical
        return inputs._replace(
            ground_moment=gain * (inputs.ground_moment - shift),
            axial_force=gain * inputs.axial_force,
            shear_force=gain * inputs.shear_force,
        )

    def _advance_plate(self, delay: float) -> Array:
        """Return the series of the plate (3, steps) a time ``delay`` [s] earlier.

        Noise stays where it is: interpolation between samples would reduce it, and a fit would prefer such delays.
        """
        steps = self._smooth_plate.x
        return self._plate_noise + self._smooth_plate(np.clip(steps + delay / self._dt, 0.0, steps[-1]))

    @cached_property
    def _plate(self) -> Array:
        """Forward and vertical force [N] and moment about the origin [N m] of the ground reaction, (3, steps)."""
        load = self._load
        moment = load.ankle_x * load.vertical - load.ankle_z * self._forward - self._inputs.ground_moment
        return np.stack([self._forward, load.vertical, moment])

    @cached_property
    def _smooth_plate(self) -> CubicSpline:
        """Series of the plate without its noise, by time step: most of the work of a correction, done once."""
        smooth = gaussian_filter1d(self._plate, SMOOTHING_TIME / self._dt, axis=1)
        return CubicSpline(np.arange(smooth.shape[1], dtype=np.float64), smooth, axis=1)

    @cached_property
    def _plate_noise(self) -> Array:
        """Series of the plate minus the smooth ones, (3, steps)."""
        return np.asarray(self._plate - self._smooth_plate(self._smooth_plate.x))


def delay_inputs(inputs: ReplayInputs, n_steps: float) -> ReplayInputs:
    """Return ``inputs`` later by ``n_steps`` time steps, which need not be whole: linear between them."""
    if n_steps == 0.0:
        return inputs
    steps = np.arange(len(inputs.shank_angle), dtype=np.float64)
    return ReplayInputs(*(np.interp(steps - n_steps, steps, series) for series in inputs))


REGISTRATION_WORDS = {
    "registration.cop_to_ankle_mm": ("the centre of pressure lies {size} mm further {direction}", "forward", "back"),
    "registration.ankle_height_mm": ("the ankle axis lies {size} mm {direction}", "higher", "lower"),
    PLATE_GAIN: ("the forces of the plate are {size} % {direction}", "larger", "smaller"),
    "registration.ankle_zero_deg": ("the ankle angle is {size} degrees {direction}", "smaller", "larger"),
    "registration.plate_delay_ms": ("the load of the plate came {size} ms {direction}", "earlier", "later"),
    COMMAND_DELAY: ("the pressure command acted {size} ms {direction}", "earlier", "later"),
}
"""Name -> statement about the corrected set-up, and the directions of a positive and of a negative correction."""
MIN_REPORTED_SIGMAS = 0.5
"""Smallest correction that is reported, in standard deviations of its prior (assumed)."""


def list_corrections(
    rows: Iterable[tuple[str, float, tuple[float, float]]], deviations: Mapping[str, float]
) -> list[str]:
    """Return a statement about each correction of the registration that matters: how the truth differs from the data.

    ``rows`` are names, fitted values and 95 % intervals of all parameters, in the units of their names, ``deviations``
    the standard deviations of those that belong to the registration.
    """
    statements = []
    for name, value, (low, high) in rows:
        is_large = abs(value) > MIN_REPORTED_SIGMAS * deviations.get(name, math.inf)
        if is_large and low * high > 0.0:
            statement, positive, negative = REGISTRATION_WORDS[name]
            direction = positive if value > 0.0 else negative
            ends = sorted((abs(low), abs(high)))
            size = f"{abs(value):.2g} [{ends[0]:.2g}, {ends[1]:.2g}]"
            statements.append(statement.format(size=size, direction=direction))
    return statements


def describe_registration(corrections: Sequence[str]) -> list[str]:
    """Return a sentence about ``corrections`` of :func:`list_corrections`, if any."""
    if not corrections:
        return []
    return [f"The fit corrected the registration (95 % intervals in brackets): {', '.join(corrections)} than measured."]
