"""A simulation that runs on and on, steered by the controls."""

import math
from typing import Any

import mujoco
import numpy as np

from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.envs.ankle_bench import AnkleBenchEnv
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.ankle_walk import AnkleWalkEnv
from klute_sim.play.controls import Controls

GAIT_STRIDES, BENCH_DURATION, WALK_DURATION = 100, 600.0, 200.0
"""Length of an episode, which then starts again: strides, and seconds."""
BENCH_CYCLE_DURATION = 2.0
"""Duration of a cycle of the crosshead [s]."""
GAIT_TIME_STEP = 1e-3
"""Time step of the gait rig [s]."""


class PlaySession:
    """The environment of a scene, and its controls."""

    def __init__(self, device: Device, controls: Controls) -> None:
        """Start the simulation of ``device``.

        Raises InputError when the device or a control does not fit the scene.
        """
        check_accepts_pressure(device, "a pressure that keys change")
        self._device, self._controls = device, controls
        self._env = self._start()

    @property
    def controls(self) -> Controls:
        """The controls."""
        return self._controls

    @property
    def model(self) -> mujoco.MjModel:
        """Model of the simulation; a change of speed or slope replaces it."""
        model: mujoco.MjModel = self._env.model
        return model

    @property
    def data(self) -> mujoco.MjData:
        """State of the simulation."""
        data: mujoco.MjData = self._env.data
        return data

    def set_controls(self, controls: Controls) -> None:
        """Change the controls; another speed or slope, or a restart, starts the simulation again.

        Raises InputError when the rig cannot walk at this speed or on this slope; the controls then stay as they are.
        """
        previous, self._controls = self._controls, controls
        if (previous.speed, previous.slope_deg) != (controls.speed, controls.slope_deg):
            try:
                self._env = self._start()
            except Exception:
                self._controls = previous
                raise
        elif previous.n_restarts != controls.n_restarts:
            self._env.reset(seed=0)

    def advance(self) -> bool:
        """Simulate 10 ms; return whether the episode ended and the next one has started."""
        if self._controls.is_paused:
            return False
        _, _, terminated, truncated, _ = self._env.step(self._make_action())
        if terminated or truncated:
            self._env.reset(seed=0)
        return bool(terminated or truncated)

    def _make_action(self) -> Any:
        fraction = self._controls.pressure_bar / self._controls.max_pressure_bar
        return np.array([2.0 * fraction - 1.0 if self._controls.scene == "bench" else fraction], dtype=np.float32)

    def _start(self) -> Any:
        controls = self._controls
        env: Any
        if controls.scene == "gait":
            env = AnkleGaitEnv(
                device=self._device,
                speed=controls.speed,
                slope=math.radians(controls.slope_deg),
                strides=GAIT_STRIDES,
                time_step=GAIT_TIME_STEP,
                reset_noise=0.0,
                action="residual",
                residual_bar=controls.max_pressure_bar,
            )
        elif controls.scene == "bench":
            duration, cycle = BENCH_DURATION, BENCH_CYCLE_DURATION
            env = AnkleBenchEnv(device=self._device, task="work", duration=duration, cycle_duration=cycle)
        else:
            env = AnkleWalkEnv(
                device=self._device,
                duration=WALK_DURATION,
                action="residual",
                residual_bar=controls.max_pressure_bar,
            )
        env.reset(seed=0)
        return env
