"""A simulation that runs on and on, steered by the controls."""

import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from klute_sim.device.device import Device, check_accepts_pressure
from klute_sim.envs.ankle_bench import AnkleBenchEnv
from klute_sim.envs.ankle_gait import AnkleGaitEnv
from klute_sim.envs.ankle_walk import AnkleWalkEnv
from klute_sim.plant.batch import find_pressure_addresses
from klute_sim.play.controls import Controls
from klute_sim.rendering.caption import format_caption

GAIT_STRIDES, BENCH_DURATION, WALK_DURATION = 100, 600.0, 200.0
"""Length of an episode, which then starts again: strides, and seconds."""
BENCH_CYCLE_DURATION = 2.0
"""Duration of a cycle of the crosshead [s]."""
GAIT_TIME_STEP = 1e-3
"""Time step of the gait rig [s]."""
PHASE_SINE = 6
"""Index of the sine of the estimated phase in the observation of a walk; its cosine follows."""


class PlaySession:
    """The environment of a scene, and its controls."""

    def __init__(self, device: Device, controls: Controls) -> None:
        """Start the simulation of ``device``.

        Raises InputError when the device or a control does not fit the scene.
        """
        check_accepts_pressure(device, "a pressure that keys change")
        self._device, self._controls = device, controls
        self._phase, self._estimate = math.nan, 0.0
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
            self._restart()

    def advance(self) -> bool:
        """Simulate 10 ms; return whether the episode ended and the next one has started."""
        if self._controls.is_paused:
            return False
        observation, _, terminated, truncated, info = self._env.step(self._make_action())
        if self._controls.scene == "gait":
            self._phase = info["gait_pct"]
        elif self._controls.scene == "walk":
            self._follow_estimate(observation)
        if terminated or truncated:
            self._restart()
        return bool(terminated or truncated)

    def describe_state(self) -> str:
        """Return the phase of the gait cycle [%], time [s] and pressure of the device [bar] as a caption.

        A walking person's phase is that of the prosthesis, estimated from its load; it is unknown before a foot strike.
        """
        scene = self._controls.scene
        (address,) = find_pressure_addresses(self.model)
        return format_caption(
            time=self.data.time,
            gait_cycle=None if scene == "bench" else self._phase,
            is_estimate=scene == "walk",
            pressure=float(self.data.act[address]),
        )

    def _restart(self) -> None:
        self._env.reset(seed=0)
        self._phase, self._estimate = math.nan, 0.0

    def _follow_estimate(self, observation: NDArray[np.float32]) -> None:
        """Set the phase [%] from the ``observation`` of a walk; a foot strike sets the estimate back."""
        sine, cosine = observation[PHASE_SINE : PHASE_SINE + 2].tolist()
        previous, self._estimate = self._estimate, 100.0 * (math.atan2(sine, cosine) / (2.0 * math.pi) % 1.0)
        if self._estimate < previous or not math.isnan(self._phase):
            self._phase = self._estimate

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
