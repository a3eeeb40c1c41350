"""Recordings of a walk that a gait laboratory can add: other speeds, loads, pressures, feet, or a clamped ankle.

Each is a change of a trial that was recorded, because nobody can command how a person walks: the replay follows the
recorded motion and ground reaction, or those of standing and hanging. What the change leaves as it is, is assumed.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from klute_sim.datasets.trial import TimeSeries
from klute_sim.diagnosis.experiments.base import MAX_WARM_UP_TIME
from klute_sim.diagnosis.experiments.gait import GaitExperiment
from klute_sim.diagnosis.experiments.registration import PlateLoad
from klute_sim.effects.families.body import MIN_KEEL_TIME_CONSTANT, add_distal_mass
from klute_sim.gait.replay.rollout import ReplayInputs
from klute_sim.laws.foot import Foot
from klute_sim.types import Array

SPEED_FACTORS = (0.75, 1.25)
"""Speeds over that of the recorded walk (assumed)."""
CARRIED_FRACTION = 0.15
"""Carried mass over that of the body (assumed)."""
CLAMPING_MOMENT = 1e9
"""Friction of a clamped ankle [N.m]."""
ADDED_MASS = 0.5
"""Mass that is attached to the foot [kg] (assumed)."""
ADDED_COMPLIANCE = np.radians(0.05)
"""Compliance by which another foot is softer [rad/(N.m)]: that of 10 N.m for half a degree (assumed)."""
STANDING_TIME = 10.0
"""Duration of a recording while standing or sitting [s] (assumed)."""
STANDING_SHARE = 0.45
"""Share of the largest vertical load of the walk that rests on the prosthesis of a person who stands (assumed: half the
body weight)."""
SWAY_FREQUENCY_HZ, SWAY_ANGLE = 0.4, np.radians(5.0)
"""Frequency [Hz] and amplitude of the lean [rad] of a person who sways (assumed)."""
STANDING_LEVER, SWAY_LEVER = 0.045, 0.06
"""Distance from the ankle forward to the centre of pressure, and its amplitude in sway [m] (assumed)."""
PRESSURE_STEP_TIME = 1.0
"""Duration of a step of pressure [s] (assumed)."""
PRESSURE_LEVELS = (0.0, 1.0, 0.5, 0.0, 0.5, 1.0)
"""Steps of pressure over the largest commanded pressure (assumed)."""
UNCHANGED_GAIT_ASSUMPTION = "the person walks as before"


class GaitProtocol(NamedTuple):
    """A recording that a laboratory can make."""

    name: str
    """Unique name."""
    instruction: str
    """What to do, to follow a verb."""
    assumption: str
    """What the prediction of this recording takes for granted."""
    change: Callable[[GaitExperiment], GaitExperiment]
    """Return the experiment of the recording from that of a recorded walk."""


def list_gait_protocols() -> tuple[GaitProtocol, ...]:
    """Return all recordings that may be proposed."""
    percent = round(100.0 * CARRIED_FRACTION)
    return (
        *(_make_speed_protocol(factor) for factor in SPEED_FACTORS),
        GaitProtocol(
            "carried_load",
            f"a walk with a rucksack of {percent} % of the body mass",
            f"motion and centre of pressure stay the same, and the ground reaction grows by {percent} %",
            _carry_load,
        ),
        GaitProtocol(
            "controller_off",
            "a walk with the controller off and the muscles vented",
            UNCHANGED_GAIT_ASSUMPTION,
            lambda walk: replace(walk, command=np.zeros_like(walk.command)),
        ),
        GaitProtocol(
            "constant_pressure",
            "a walk with constant pressure, half of the largest so far",
            UNCHANGED_GAIT_ASSUMPTION,
            lambda walk: replace(walk, command=np.full_like(walk.command, 0.5 * walk.command.max())),
        ),
        GaitProtocol(
            "clamped_ankle",
            "a walk with the ankle clamped at its neutral angle",
            f"the clamp is rigid, and {UNCHANGED_GAIT_ASSUMPTION}",
            lambda walk: replace(walk, foot_change=_clamp_ankle),
        ),
        GaitProtocol(
            "markers_below_socket",
            "a walk with all markers of the shank on the prosthesis, below the socket",
            UNCHANGED_GAIT_ASSUMPTION,
            lambda walk: replace(walk, foot_change=_hold_socket),
        ),
        GaitProtocol(
            "mass_on_foot",
            f"a walk with {ADDED_MASS:g} kg attached to the foot, at its centre of mass",
            UNCHANGED_GAIT_ASSUMPTION,
            lambda walk: replace(walk, foot_change=_add_mass),
        ),
        GaitProtocol(
            "softer_foot",
            "a walk with another foot or shoe that is known to yield by "
            f"{np.degrees(ADDED_COMPLIANCE):.2g} degrees per N·m more",
            f"its compliance was measured, and {UNCHANGED_GAIT_ASSUMPTION}",
            lambda walk: replace(walk, foot_change=_soften_foot),
        ),
        GaitProtocol(
            "sway",
            f"{STANDING_TIME:.0f} s of standing with half the weight on the prosthesis, swaying forward and back by "
            f"{np.degrees(SWAY_ANGLE):.0f} degrees at {SWAY_FREQUENCY_HZ:g} Hz under constant pressure",
            f"the centre of pressure moves by {1e3 * SWAY_LEVER:.0f} mm forward and back",
            lambda walk: _stand(walk, SWAY_ANGLE, SWAY_LEVER, (0.5,)),
        ),
        GaitProtocol(
            "pressure_steps_standing",
            f"{STANDING_TIME:.0f} s of standing still with half the weight on the prosthesis, with a pressure step "
            f"every {PRESSURE_STEP_TIME:g} s",
            f"the centre of pressure stays {1e3 * STANDING_LEVER:.0f} mm in front of the ankle",
            lambda walk: _stand(walk, 0.0, 0.0, PRESSURE_LEVELS),
        ),
        GaitProtocol(
            "pressure_steps_hanging",
            f"{STANDING_TIME:.0f} s of sitting with the foot in the air, with a pressure step every "
            f"{PRESSURE_STEP_TIME:g} s",
            "the shank is held still and upright",
            lambda walk: _stand(walk, 0.0, 0.0, PRESSURE_LEVELS, share=0.0),
        ),
    )


def _make_speed_protocol(factor: float) -> GaitProtocol:
    name, amount = ("faster", "less") if factor > 1.0 else ("slower", "more")
    return GaitProtocol(
        name,
        f"a walk at {factor:g} times the speed",
        f"angles, ground reaction and pressures over the stride stay the same, in {amount} time",
        lambda walk: _change_speed(walk, factor),
    )


def _change_speed(walk: GaitExperiment, factor: float) -> GaitExperiment:
    """Return ``walk`` with all inputs ``factor`` times as fast, and as many samples per stride."""
    elapsed = walk.dt * np.arange(len(walk.command), dtype=np.float64)
    source = factor * walk.dt * np.arange(int(len(elapsed) / factor), dtype=np.float64)

    def resample(series: Array) -> Array:
        return np.interp(source, elapsed, series)

    inputs = ReplayInputs(*map(resample, walk.inputs))
    inputs = inputs._replace(
        shank_angular_acceleration=factor**2 * inputs.shank_angular_acceleration,
        ankle_acceleration_x=factor**2 * inputs.ankle_acceleration_x,
        ankle_acceleration_z=factor**2 * inputs.ankle_acceleration_z,
    )
    measured = {
        name: TimeSeries(walk.start_time + (series.time - walk.start_time) / factor, series.value)
        for name, series in walk.measured.items()
    }
    return replace(
        walk,
        inputs=inputs,
        smoothed_inputs=inputs,
        command=resample(walk.command),
        load=walk.load.map(resample),
        foot_strikes=walk.foot_strikes / factor,
        mean_stride_time=walk.mean_stride_time / factor,
        measured=measured,
    )


def _carry_load(walk: GaitExperiment) -> GaitExperiment:
    factor, inputs = 1.0 + CARRIED_FRACTION, walk.inputs
    inputs = inputs._replace(
        ground_moment=factor * inputs.ground_moment,
        axial_force=factor * inputs.axial_force,
        shear_force=factor * inputs.shear_force,
    )
    load = walk.load._replace(vertical=factor * walk.load.vertical)
    return replace(walk, inputs=inputs, smoothed_inputs=inputs, load=load)


def _clamp_ankle(foot: Foot) -> Foot:
    return foot._replace(ankle_friction=CLAMPING_MOMENT)


def _hold_socket(foot: Foot) -> Foot:
    return foot._replace(socket_compliance=0.0, tilt_compliance=0.0)


def _add_mass(foot: Foot) -> Foot:
    inertia = foot.inertia + ADDED_MASS * (foot.com_x**2 + foot.com_z**2)
    return add_distal_mass(foot, ADDED_MASS)._replace(mass=foot.mass + ADDED_MASS, inertia=inertia)


def _soften_foot(foot: Foot) -> Foot:
    return foot._replace(
        keel_compliance=foot.keel_compliance + ADDED_COMPLIANCE,
        keel_time_constant=max(foot.keel_time_constant, MIN_KEEL_TIME_CONSTANT),
    )


def _stand(
    walk: GaitExperiment, lean: float, lever: float, levels: tuple[float, ...], *, share: float = STANDING_SHARE
) -> GaitExperiment:
    """Return the experiment of a person who stands, with ``share`` of the largest load of ``walk`` on the prosthesis.

    The shank leans by ``lean`` [rad] and the centre of pressure moves by ``lever`` [m] forward and back. The pressure
    is at each of ``levels``, over the largest command of the walk, in turn.
    """
    elapsed = walk.dt * np.arange(round(STANDING_TIME / walk.dt), dtype=np.float64)
    rate = 2.0 * np.pi * SWAY_FREQUENCY_HZ
    wave, still = np.sin(rate * elapsed), np.zeros_like(elapsed)
    load = np.full_like(elapsed, share * walk.load.vertical.max())
    steps = (elapsed / PRESSURE_STEP_TIME).astype(int) % len(levels)
    command = walk.command.max() * np.asarray(levels)[steps]
    inputs = ReplayInputs(
        shank_angle=lean * wave,
        shank_angular_acceleration=-(rate**2) * lean * wave,
        ankle_acceleration_x=still,
        ankle_acceleration_z=still,
        ground_moment=-load * (STANDING_LEVER + lever * wave),
        axial_force=load * np.cos(lean * wave),
        shear_force=load * np.sin(lean * wave),
        pressure_command=command,
    )
    interval = min(series.sampling_interval for series in walk.measured.values())
    time = walk.start_time + np.arange(MAX_WARM_UP_TIME, elapsed[-1], interval)
    measured = {name: TimeSeries(time, time) for name in walk.measured}
    return replace(
        walk,
        inputs=inputs,
        smoothed_inputs=inputs,
        command=command,
        load=PlateLoad(load, still, still),
        measured=measured,
    )
