"""``klute_sim/AnkleGait-v1``: walk a powered ankle on the gait rig, one command every 10 ms."""

from collections.abc import Mapping
from copy import copy
from dataclasses import fields
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.envs.tasks.domain_randomization import RandomisationRanges
from klute_sim.envs.tasks.gait_task import CONTROL_INTERVAL, GaitTask, SimulationStates
from klute_sim.envs.tasks.instruments import OBSERVATIONS
from klute_sim.envs.tasks.options import TaskOptions, resolve_device
from klute_sim.errors import InputError, SimulationError
from klute_sim.gait.rig.setup import DRIVE_ACTUATORS, GaitOptions, GaitRig, reset_gait_rig
from klute_sim.plant import callbacks
from klute_sim.units import BAR

Observation = NDArray[np.float32]
MAX_PIXELS = 4096


def make_observation_space() -> "spaces.Box[np.float32]":
    """What a prosthesis can sense."""
    low, high = (np.array([row[k] for row in OBSERVATIONS], dtype=np.float32) for k in (2, 3))
    return spaces.Box(low, high, dtype=np.float32)


def make_action_space() -> "spaces.Box[np.float32]":
    """One number; what it means is :data:`klute_sim.envs.tasks.actions.ACTIONS`."""
    return spaces.Box(-1.0, 1.0, (1,), np.float32)


class AnkleGaitEnv(gymnasium.Env[Observation, NDArray[np.float32]], gymnasium.utils.EzPickle):
    """A powered below-knee prosthesis on the gait rig of ``klute-sim gait``.

    The residual limb follows measured human gait and the reference's load is applied to it; the policy commands the
    artificial muscle and is rewarded for an ankle that moves and pushes like the human one.

    ## Action space

    ``Box(-1, 1, (1,), float32)``, held for 10 ms. What is beyond is clipped; NaN is refused. The regulator's own limits
    (rate) act after that. The keyword ``action`` says what is commanded:

    | action | meaning |
    |---|---|
    | ``pressure`` | gauge pressure, from none (-1) to all that the supply has (1) |
    | ``valve`` | opening of the valve, from exhaust (-1) to fill (1) |
    | ``residual`` | change of a base profile's pressure, from -residual_bar (-1) to residual_bar (1) |

    Left out it is ``valve`` for a device that takes openings, which can have no other, and ``pressure`` for the rest.
    The base ``profile`` is that of ``klute-sim gait``, at the *estimated* phase of the gait; pressures stay within what
    the supply has.

    ## Observation space

    ``Box((8,), float32)``: what a prosthesis can sense, clipped to the bounds.

    | # | observation | unit | low | high | typical noise |
    |---|---|---|---|---|---|
    | 0 | ankle angle, dorsiflexion positive | rad | -1 | 1 | 0.002 |
    | 1 | ankle velocity, dorsiflexion positive | rad/s | -50 | 50 | 0.05 |
    | 2 | shank inclination, forward positive | rad | -3.2 | 3.2 | 0.01 |
    | 3 | shank angular velocity, forward positive | rad/s | -50 | 50 | 0.02 |
    | 4 | axial load in the pylon, compression positive | body weights | -5 | 5 | 0.01 |
    | 5 | gauge pressure | bar | 0 | 20 | 0.02 |
    | 6 | sine of the estimated gait phase | 1 | -1 | 1 | 0 |
    | 7 | cosine of the estimated gait phase | 1 | -1 | 1 | 0 |

    ``sensor_noise`` is the standard deviation in units of the typical one (0: none), normal and new every 10 ms;
    ``sensor_delay`` is by how many whole intervals of 10 ms everything is late. The phase is estimated as the
    prosthesis could, from the load as it is sensed: time since the last foot strike (load above 0.1 body weights) over
    the time between the last two.

    ## Reward

    The sum of these terms, each in ``info``; the keyword ``reward`` replaces weights by name, as in ``{"air": -0.2}``:

    | term | value |
    |---|---|
    | ``reward_moment`` | 0.4 exp(-d²/2), d = distance of the net ankle moment from the human one, in 0.2 N·m/kg |
    | ``reward_angle`` | 0.3 exp(-d²/2), d in 5 degrees |
    | ``reward_power`` | 0.3 exp(-d²/2), d in 0.5 W/kg |
    | ``reward_work`` | 0.1 times positive power, as far as the human ankle has it then, in its mean over the stride |
    | ``reward_air`` | -0.1 per gram of air drawn per 0.1 s |
    | ``reward_smoothness`` | -0.05 times the squared change of the action |

    ``info`` also holds ``gait_pct`` (true phase), ``ankle_moment_nm_per_kg``, ``ankle_power_w_per_kg``,
    ``pressure_command_bar`` (or ``valve_command``), and what the interval came to: air drawn, leaked,
    and held at its end (``air_g``, ``air_leaked_g``, ``air_held_g``); the work that gas, friction offset, damper, the
    stores of bladder and tendon, and each effect gave (``work_gas_j``, ``work_friction_j``, ``work_damper_j``,
    ``work_bladder_j``, ``work_tendon_j``, ``work_effect_<name>_j``), what was delivered (``work_delivered_j``), and
    what reading once per interval leaves open (``work_unresolved_j``).

    ## Episode

    Starts at heel strike, the ankle within ``reset_noise`` of the reference's angle and the pressure anywhere between
    0 and a quarter of the supply's (0 if the device takes openings). Truncated after ``strides`` strides; terminated
    when the rig leaves its path or a state is not finite.

    ## Randomisation

    ``randomise`` is a :class:`klute_sim.envs.tasks.domain_randomization.Randomise`, or a mapping with its names. What was drawn is in
    the ``info`` of the reset, under the names on the right.

    | name | draws | in ``info`` |
    |---|---|---|
    | ``mass_share`` | body mass within a share of ``mass`` | ``mass_kg`` |
    | ``speed_m_per_s`` | walking speed, from a range | ``speed_m_per_s`` |
    | ``slope_deg`` | slope of the ground, from a range, uphill positive | ``slope_deg`` |
    | ``device`` | numbers of the device file within a share, as in ``{"muscle.c10_kpa": 0.1}`` | the keys |
    | ``effects`` | as in ``{"pressure_lag": {"time_constant_s": (0, 0.05)}}`` | ``effects.<name>.<key>`` |

    Mass, speed and slope each have 9 values, evenly over their range: a rig for each is put together when it is first
    drawn, and kept. The Achilles origin stays where the usual device has it.

    ## Versions

    * v1: kinds of actions, noise and delay of sensors, weights of the reward, randomisation, slope; positive work is
      rewarded. With ``reward={"work": 0}`` and all else left out, episodes are those of v0.
    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / CONTROL_INTERVAL)}  # noqa: RUF012

    def __init__(
        self,
        *,
        device: Device | str | Path = DEFAULT_DEVICE,
        mass: float = 75.0,
        stature: float = 1.75,
        speed: float | None = None,
        slope: float = 0.0,
        strides: int = 5,
        time_step: float = 5e-4,
        backend: str = "auto",
        action: str | None = None,
        residual_bar: float = 1.0,
        profile: PressureProfile | None = None,
        sensor_noise: float = 0.0,
        sensor_delay: int = 0,
        reward: Mapping[str, float] | None = None,
        randomise: RandomisationRanges | Mapping[str, Any] | None = None,
        reset_noise: float = 0.02,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
    ) -> None:
        """For a ``device`` (preset, file or Device), a subject (kg, m, m/s), a ``slope`` [rad] and a ``step`` [s].

        ``law`` is one of :data:`klute_sim.device.backend.select.LAWS`; ``reset_noise`` [rad], and what is not named
        here is in the tables above (:class:`klute_sim.envs.tasks.options.TaskOptions`). Raises InputError for what cannot be.
        """
        gymnasium.utils.EzPickle.__init__(**locals())
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode is '{render_mode}'; allowed: None, rgb_array")
        walker = GaitOptions(mass=mass, stature=stature, speed=speed, slope=slope, strides=strides, dt=time_step)
        options = TaskOptions(
            action=action,
            residual_bar=residual_bar,
            profile=profile,
            sensor_noise=sensor_noise,
            sensor_delay=sensor_delay,
            reward=reward,
            randomise=randomise,
            reset_noise=reset_noise,
        )
        self._backend, self._reset_noise = callbacks.choose_backend(backend), reset_noise
        self._task, self._single_mask = (
            GaitTask(resolve_device(device), walker, options, 1, self._backend),
            np.ones(1, dtype=np.bool_),
        )
        self._gait_rig = self._task.randomiser.gait_rigs[0]
        self.model = copy(self._gait_rig.model)
        """The MuJoCo model, with the device in it; randomisation changes it at every reset."""
        self.data = mujoco.MjData(self.model)
        """The simulation."""
        self.render_mode = render_mode
        self.action_space, self.observation_space = make_action_space(), make_observation_space()
        if not (0 < width <= MAX_PIXELS and 0 < height <= MAX_PIXELS):
            raise InputError(f"pictures are {width} x {height}; allowed: 1 to {MAX_PIXELS} pixels a side")
        self._image_size = (height, width)
        self.model.vis.global_.offwidth = max(width, self.model.vis.global_.offwidth)
        self.model.vis.global_.offheight = max(height, self.model.vis.global_.offheight)
        self._renderer: mujoco.Renderer | None = None

    @property
    def dt(self) -> float:
        """Time between two actions [s]."""
        return CONTROL_INTERVAL

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Heel strike; there are no ``options``."""
        super().reset(seed=seed)
        episode = self._task.randomiser.sample(self.np_random)
        self._gait_rig = self._task.randomiser.apply(episode, self.model)
        reset_simulation(self._gait_rig, self.data, self.np_random, self._reset_noise)
        self._task.assign_episode(0, episode)
        self._task.reset(self._single_mask, self._read_states(), [self.np_random])
        return self._task.observations[0], dict(episode.drawn_values)

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold ``action`` for one interval; raises InputError if it is no number."""
        chosen = validate_action(action, (1,))
        command = self._task.decode_action(chosen)
        self.data.ctrl[: len(DRIVE_ACTUATORS)] = self._task.drive_command_rates()[0]
        with callbacks.device_callbacks(self._backend):
            try:
                for steps, asked in self._task.schedule_commands(command, self._single_mask):
                    self.data.ctrl[self._gait_rig.actuator.ctrl_address] = asked[0]
                    callbacks.step_model(self.model, self.data, steps)
            except SimulationError:
                self.data.act[self._gait_rig.actuator.act_address] = (
                    np.nan
                )  # under either law, a failed device ends the episode
        now, random = self._read_states(), [self.np_random]
        reward, terminated, truncated, told = self._task.evaluate(chosen, command, now, self._single_mask, random)
        info = {name: float(value[0]) for name, value in told.items()}
        return self._task.observations[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def _read_states(self) -> SimulationStates:
        d = self.data
        return SimulationStates(*(getattr(d, field.name)[None] for field in fields(SimulationStates)))

    def render(self) -> NDArray[np.uint8] | None:
        """The leg from its side, (height, width, 3); None without a render mode."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            self._renderer = mujoco.Renderer(self.model, *self._image_size)
        camera = mujoco.MjvCamera()
        camera.lookat[:] = (self.data.qpos[0], 0.0, 0.55)
        camera.distance, camera.azimuth, camera.elevation = 1.9, 90.0, -5.0
        self._renderer.update_scene(self.data, camera)
        picture: NDArray[np.uint8] = self._renderer.render()
        return picture

    def close(self) -> None:
        """Free the renderer."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def reset_simulation(gait_rig: GaitRig, data: mujoco.MjData, rng: np.random.Generator, reset_noise: float) -> None:
    """Put ``data`` at the beginning of an episode."""
    pressure = rng.uniform(0.0, 0.25 * gait_rig.actuator.parameters.supply.max_pressure)
    reset_gait_rig(gait_rig, data, pressure, rng.uniform(-reset_noise, reset_noise))
    data.ctrl[gait_rig.actuator.ctrl_address] = (
        0.0 if gait_rig.actuator.parameters.supply.command_is_opening != 0.0 else pressure / BAR
    )


def validate_action(
    action: NDArray[np.floating[Any]], shape: tuple[int, ...], mask: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """The action as numbers, 0 in rows that do not count; raises InputError for another shape, or NaN where it does."""
    chosen = np.array(action, dtype=np.float64)
    if chosen.shape != shape:
        raise InputError(f"action has shape {chosen.shape}; allowed: {shape}")
    if mask is not None:
        chosen[~mask] = 0.0
    if np.isnan(chosen).any():
        raise InputError("action is not a number; allowed: -1 to 1")
    return chosen
