"""``klute_sim/AnkleGait-v2``: control of a powered ankle on the gait rig with one command every 10 ms."""

from collections.abc import Collection, Mapping
from copy import copy
from dataclasses import fields
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from klute_sim.controllers.pressure import PressureProfile
from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.envs.base.single import SINGLE_MASK, DeviceEnv, Observation, Step
from klute_sim.envs.base.task import make_action_space, make_observation_space
from klute_sim.envs.tasks.domain_randomization import RandomizationRanges
from klute_sim.envs.tasks.gait_task import GaitTask, SimulationStates
from klute_sim.envs.tasks.instruments import OBSERVATIONS
from klute_sim.envs.tasks.options import TaskOptions, resolve_device, resolve_gait_options
from klute_sim.errors import SimulationError
from klute_sim.gait.rig.setup import DRIVE_ACTUATORS, GaitRig, reset_gait_rig
from klute_sim.gait.subject import ReferenceLike
from klute_sim.plant import callbacks
from klute_sim.rendering.frames import DEFAULT_CAMERA, RenderOptions
from klute_sim.types import Array
from klute_sim.units import BAR


class AnkleGaitEnv(DeviceEnv):
    """A powered below-knee prosthesis on the gait rig of ``klute-sim gait``.

    The residual limb follows measured human gait on the path of the hip that the rig learned with the base ``profile``,
    on which the foot then carries the load of the reference. The policy commands the artificial muscle. It is rewarded
    for an ankle that moves and pushes like the human one under the human load.

    ## Action space

    ``Box(-1, 1, (1,), float32)``, held for 10 ms. Values outside are clipped; NaN and infinity are refused. The rate
    limit of the regulator acts on the command. The keyword ``action`` selects the meaning:

    | action | meaning |
    |---|---|
    | ``pressure`` | gauge pressure, from 0 (-1) to the supply pressure (1) |
    | ``valve`` | opening of the valve, from exhaust (-1) to fill (1) |
    | ``residual`` | change of the pressure of a base profile, from -residual_bar (-1) to residual_bar (1) |

    Default: ``valve`` for a device that takes valve openings, which allows no other kind, and ``pressure`` otherwise.
    The base ``profile`` is that of ``klute-sim gait`` at the *estimated* gait phase. Pressures are clipped to the
    supply pressure.

    ## Observation space

    ``Box((8,), float32)``: signals that a prosthesis can measure, clipped to the bounds.

    | # | observation | unit | low | high | typical noise |
    |---|---|---|---|---|---|
    | 0 | angle of the ankle hinge, dorsiflexion positive | rad | -1 | 1 | 0.002 |
    | 1 | velocity of the ankle hinge, dorsiflexion positive | rad/s | -50 | 50 | 0.05 |
    | 2 | shank inclination, forward positive | rad | -3.2 | 3.2 | 0.01 |
    | 3 | shank angular velocity, forward positive | rad/s | -50 | 50 | 0.02 |
    | 4 | axial load in the pylon, compression positive | body weights | -5 | 5 | 0.01 |
    | 5 | gauge pressure | bar | 0 | 20 | 0.02 |
    | 6 | sine of the estimated gait phase | 1 | -1 | 1 | 0 |
    | 7 | cosine of the estimated gait phase | 1 | -1 | 1 | 0 |

    ``sensor_noise`` multiplies the typical standard deviation (0: no noise); the noise is normal, with new values
    every 10 ms. ``sensor_delay`` is the delay in whole intervals of 10 ms. The phase is estimated from the measured
    load, as in a prosthesis: time since the last foot strike (load above 0.1 body weights) over the time between the
    last two strikes.

    ## Reward

    The reward is the sum of these terms, each in ``info``. The keyword ``reward`` replaces weights, as in
    ``{"air": -0.2}``.

    | term | value |
    |---|---|
    | ``reward_moment`` | 0.4 exp(-d²/2), d = deviation of the net ankle moment from the human one, in 0.2 N·m/kg |
    | ``reward_angle`` | 0.3 exp(-d²/2), d = deviation of the angle of the foot to the limb, in 5 degrees |
    | ``reward_power`` | 0.3 exp(-d²/2), d = deviation of the ankle power, in 0.5 W/kg |
    | ``reward_work`` | 0.1 times positive power, limited to that of the human ankle, over its mean in the stride |
    | ``reward_air`` | -0.1 per gram of air drawn per 0.1 s |
    | ``reward_smoothness`` | -0.05 times the squared change of the action |
    | ``reward_load`` | -2 e², e = error of the vertical ground reaction in body weights, limited to 1 |
    | ``reward_braking`` | -20 b², b = braking above 0.2 body weights, limited to 0.2 |

    ``info`` also holds ``gait_pct`` (true phase), ``ankle_moment_nm_per_kg``, ``ankle_power_w_per_kg``,
    ``pressure_command_bar`` (or ``valve_command``), and the totals of the interval: air drawn, leaked, and held at its
    end (``air_g``, ``air_leaked_g``, ``air_mass_g``); work of gas, friction offset, damper, the elastic energies of
    bladder and tendon, and each effect (``work_gas_j``, ``work_friction_j``, ``work_damper_j``, ``work_bladder_j``,
    ``work_tendon_j``, ``work_effect_<name>_j``); delivered work (``work_delivered_j``); and the error of sampling once
    per interval (``work_unresolved_j``).

    ## Episode

    An episode starts at heel strike, with the ankle within ``reset_noise`` of the reference angle and a random pressure
    between 0 and a quarter of the supply pressure (0 for a device that takes valve openings). It is truncated after
    ``strides`` strides and terminated when the rig leaves its path or a state is not finite.

    ## Domain randomisation

    ``domain_randomization`` is a :class:`~klute_sim.envs.tasks.domain_randomization.RandomizationRanges`, or a mapping
    with its field names. The ``info`` of the reset holds the sampled values under the names on the right.

    | name | samples | in ``info`` |
    |---|---|---|
    | ``mass_fraction`` | body mass within a fraction of ``mass`` | ``mass_kg`` |
    | ``speed_m_per_s`` | walking speed, from a range | ``speed_m_per_s`` |
    | ``speed_fraction`` | walking speed, from a range relative to the nominal one | ``speed_m_per_s`` |
    | ``slope_deg`` | slope of the ground, from a range, uphill positive | ``slope_deg`` |
    | ``device`` | numbers of the device file within a fraction, as in ``{"muscle.c10_kpa": 0.1}`` | the keys |
    | ``effects`` | as in ``{"pressure_lag": {"time_constant_s": (0, 0.05)}}`` | ``effects.<name>.<key>`` |

    Mass, speed and slope each have 5 evenly spaced values. The rig of each combination is built and cached when it is
    first sampled. The Achilles origin stays where the nominal device has it.

    ## Versions

    * v2: the rig carries the load of the subject on a learned path; load and braking count; any subject; the air of an
      ideal regulator is summed at every time step.
    * v1: kinds of actions, noise and delay of sensors, weights of the reward, randomisation, slope; positive work is
      rewarded.
    * v0: first version.
    """

    def __init__(
        self,
        *,
        device: Device | str | Path = DEFAULT_DEVICE,
        mass: float | None = None,
        stature: float | None = None,
        speed: float | None = None,
        slope: float = 0.0,
        reference: ReferenceLike = None,
        stride_time: float | None = None,
        accept: Collection[str] = (),
        foot: str | None = None,
        strides: int = 5,
        time_step: float = 5e-4,
        backend: str = "auto",
        action: str | None = None,
        residual_bar: float = 1.0,
        profile: PressureProfile | None = None,
        sensor_noise: float = 0.0,
        sensor_delay: int = 0,
        reward: Mapping[str, float] | None = None,
        domain_randomization: RandomizationRanges | Mapping[str, Any] | None = None,
        reset_noise: float = 0.02,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str = DEFAULT_CAMERA,
    ) -> None:
        """Create the environment of a ``device`` (preset, path or Device) and a subject (mass [kg], stature [m]).

        ``reference`` is the gait of the subject, or the path of its file or folder (None: able-bodied adults);
        ``stride_time`` [s], mass and stature are by default those that it states (None), or 1.1 s, 75 kg and 1.75 m.
        ``foot`` is the foot below the ankle, such as ``"sach"`` (None: that of the device).
        ``accept`` names findings about its file that are right although they look implausible. ``speed`` [m/s],
        ``slope`` [rad], ``time_step`` [s] and ``reset_noise`` [rad]; ``backend`` is auto, compiled or python. With the
        ``render_mode`` human, rgb_array or depth_array it draws, from a ``camera`` of the model (side, corner,
        prosthesis_close), images of ``width`` and ``height`` [pixels]. The class docstring and
        :class:`klute_sim.envs.tasks.options.TaskOptions` describe the other options.

        Raises InputError when an option is invalid.
        """
        render_options = RenderOptions(render_mode=render_mode, width=width, height=height, camera=camera)
        gait_options = resolve_gait_options(
            reference, stride_time, accept, mass, stature, speed, slope, strides, time_step
        )
        options = TaskOptions(
            action=action,
            residual_bar=residual_bar,
            profile=profile,
            sensor_noise=sensor_noise,
            sensor_delay=sensor_delay,
            reward=reward,
            domain_randomization=domain_randomization,
            reset_noise=reset_noise,
        )
        self._backend, self._reset_noise = callbacks.choose_backend(backend), reset_noise
        self._task = GaitTask(resolve_device(device, foot), gait_options, options, 1, self._backend)
        self._gait_rig = self._task.randomizer.gait_rigs[0]
        super().__init__(self._task.max_episode_steps, render_options)
        self.model = copy(self._gait_rig.model)
        """MuJoCo model including the device; randomisation changes it at every reset."""
        self.data = mujoco.MjData(self.model)
        """State of the simulation."""
        render_options.check_camera(self.model)
        self.action_space, self.observation_space = make_action_space(), make_observation_space(OBSERVATIONS)

    def _start_episode(self) -> tuple[Observation, dict[str, Any]]:
        episode = self._task.randomizer.sample(self.np_random)
        self._gait_rig = self._task.randomizer.apply(episode, self.model)
        with callbacks.device_callbacks(self._backend, is_isolated=True):
            reset_simulation(self._gait_rig, self.data, self.np_random, self._reset_noise)
        self._task.assign_episode(0, episode)
        self._task.reset(SINGLE_MASK, self._read_states(), [self.np_random])
        return self._task.observations[0], dict(episode.sampled_values)

    def _advance(self, action: Array) -> Step:
        command = self._task.decode_action(action)
        self.data.ctrl[: len(DRIVE_ACTUATORS)] = self._task.get_drive_command_rates()[0]
        act, acts = self.data.act, []
        with callbacks.device_callbacks(self._backend, is_isolated=True):
            try:
                for steps, scheduled_command in self._task.schedule_commands(command, SINGLE_MASK):
                    self.data.ctrl[self._gait_rig.actuator.ctrl_address] = scheduled_command[0]
                    for count in [1] * steps if self._task.samples_air else [steps]:
                        callbacks.step_model(self.model, self.data, count)
                        acts.append(act.copy())
            except SimulationError:
                self.data.act[self._gait_rig.actuator.act_address] = (
                    np.nan
                )  # under either law, a failed device ends the episode
        if self._task.samples_air:
            self._task.add_steps(SINGLE_MASK, np.reshape(acts, (1, -1, self.model.na)))
        step = self._task.evaluate(action, command, self._read_states(), SINGLE_MASK, [self.np_random])
        reward, terminated, truncated = float(step.reward[0]), bool(step.terminated[0]), bool(step.truncated[0])
        return self._task.observations[0], reward, terminated, truncated, step.get_first_info()

    def _get_simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        return self.model, self.data

    def _read_states(self) -> SimulationStates:
        data = self.data
        return SimulationStates(*(getattr(data, field.name)[None] for field in fields(SimulationStates)))


def reset_simulation(gait_rig: GaitRig, data: mujoco.MjData, rng: np.random.Generator, reset_noise: float) -> None:
    """Set ``data`` to the beginning of an episode."""
    pressure = rng.uniform(0.0, 0.25 * gait_rig.actuator.parameters.supply.max_pressure)
    reset_gait_rig(gait_rig, data, pressure, rng.uniform(-reset_noise, reset_noise))
    data.ctrl[gait_rig.actuator.ctrl_address] = (
        0.0 if gait_rig.actuator.parameters.supply.command_is_opening != 0.0 else pressure / BAR
    )
