"""``klute_sim/AntagonistJoint-v0``: control of the angle of a joint with the pressures of two muscles."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from gymnasium import spaces

from klute_sim.device.device import Device
from klute_sim.envs.base.single import DeviceEnv, Observation, Step
from klute_sim.envs.tasks.joint_task import (
    CONTROL_INTERVAL,
    OBSERVATIONS,
    TENDONS,
    JointOptions,
    JointStates,
    JointTask,
)
from klute_sim.envs.tasks.options import resolve_device
from klute_sim.errors import InputError, SimulationError, suggest
from klute_sim.plant import callbacks
from klute_sim.types import Array

DEFAULT_JOINT_DEVICE = "klute-3-4-pair"
"""Default device on both tendons."""
SINGLE_MASK = np.ones(1, dtype=np.bool_)


def make_action_space() -> "spaces.Box[np.float32]":
    """Return the space of both actions."""
    return spaces.Box(-1.0, 1.0, (len(TENDONS),), dtype=np.float32)


def make_observation_space() -> "spaces.Box[np.float32]":
    """Return the space of the observations of the joint."""
    low, high = (np.array([row[k] for row in OBSERVATIONS], dtype=np.float32) for k in (2, 3))
    return spaces.Box(low, high, dtype=np.float32)


def resolve_devices(device: "Device | str | Path | Mapping[str, Device | str | Path]") -> dict[str, Device]:
    """Return tendon -> device; raises InputError for a tendon that the joint lacks or that gets no device."""
    if not isinstance(device, Mapping):
        return dict.fromkeys(TENDONS, resolve_device(device))
    for name in (*device, *TENDONS):
        if name not in TENDONS or name not in device:
            listing = f"give one device, or one for each of: {', '.join(TENDONS)}"
            raise InputError(f"the tendon '{name}' has no device or does not exist; {suggest(name, TENDONS, listing)}")
    return {name: resolve_device(device[name]) for name in TENDONS}


class AntagonistJointEnv(DeviceEnv):
    """A lever on a pulley between a flexor and an extensor, both with a device, under gravity.

    ## Action space

    ``Box(-1, 1, (2,), float32)``, flexor and extensor, held for 10 ms: gauge pressure from 0 (-1) to the supply
    pressure (1), or, for a device that takes valve openings, the opening from exhaust (-1) to fill (1). Values outside
    are clipped; NaN and infinity are refused.

    ## Observation space

    ``Box((6,), float32)``, clipped to the bounds:

    | # | observation | unit | low | high |
    |---|---|---|---|---|
    | 0 | angle | rad | -4 | 4 |
    | 1 | angular velocity | rad/s | -50 | 50 |
    | 2 | target angle | rad | -4 | 4 |
    | 3 | rate of the target angle | rad/s | -50 | 50 |
    | 4 | gauge pressure of the flexor | bar | 0 | 20 |
    | 5 | gauge pressure of the extensor | bar | 0 | 20 |

    ## Reward

    | term | value |
    |---|---|
    | ``reward_angle`` | exp(-d²/2), d = deviation from the target angle, in 5 degrees |
    | ``reward_smoothness`` | -0.05 times the squared change of the actions, summed over both |

    The target is a sum of four sines of up to 1 Hz within 60 % of the joint's range (-30 to 100 degrees). ``info``
    holds the terms, ``angle_error_deg``, ``force_flexor_n`` and ``force_extensor_n``.

    ## Episode

    An episode starts at rest at a random angle with just taut tendons and random pressures of 0.3 to 0.6 of the supply
    pressure (0 for a device that takes valve openings); the target leads away from there in half a second. It is
    truncated after ``duration`` seconds and terminated when a state is not finite.

    ## Versions

    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": round(1.0 / CONTROL_INTERVAL)}  # noqa: RUF012

    def __init__(
        self,
        *,
        device: Device | str | Path | Mapping[str, Device | str | Path] = DEFAULT_JOINT_DEVICE,
        duration: float = 5.0,
        time_step: float = 5e-4,
        backend: str = "auto",
        render_mode: None = None,
    ) -> None:
        """Create the environment with a ``device`` (preset, path or Device) on both tendons, or one for each.

        ``duration`` [s] of an episode, ``time_step`` [s]; ``backend`` is auto, compiled or python. Raises InputError
        when an option is invalid.
        """
        if render_mode is not None:
            raise InputError(f"render_mode is {render_mode!r}; allowed: None")
        options = JointOptions(duration=duration, time_step=time_step)
        super().__init__(options.actions_per_episode)
        self._backend = callbacks.choose_backend(backend)
        self._task = JointTask(resolve_devices(device), options, 1, self._backend)
        self.model = self._task.model
        """MuJoCo model of the joint including the devices."""
        self.data = mujoco.MjData(self.model)
        """State of the simulation."""
        self.render_mode = render_mode
        self.action_space, self.observation_space = make_action_space(), make_observation_space()

    @property
    def dt(self) -> float:
        """Return the interval between two actions [s]."""
        return CONTROL_INTERVAL

    def _start_episode(self) -> tuple[Observation, dict[str, Any]]:
        self._task.start_episode(0, self.data, self.np_random)
        self._task.reset(SINGLE_MASK, self._read_states())
        return self._task.observations[0], {}

    def _advance(self, action: Array) -> Step:
        actions = action[None]
        with callbacks.device_callbacks(self._backend, is_isolated=True):
            try:
                for control in self._task.schedule_controls(actions, SINGLE_MASK)[0]:
                    self.data.ctrl[:] = control
                    callbacks.step_model(self.model, self.data)
            except SimulationError:
                # Under either law, a failed device ends the episode.
                self.data.act[self._task.actuators[0].act_address] = np.nan
        reward, terminated, truncated, arrays = self._task.evaluate(actions, self._read_states(), SINGLE_MASK)
        info = {name: float(value[0]) for name, value in arrays.items()}
        return self._task.observations[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def _read_states(self) -> JointStates:
        return JointStates(*(getattr(self.data, field.name)[None] for field in fields(JointStates)))
