"""``klute_sim/AnkleWalk-v0``: control of a powered ankle of a person who walks by muscles and reflexes."""

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import mujoco

from klute_sim.controllers.parse import Controller, parse_controller
from klute_sim.device.device import DEFAULT_DEVICE, Device
from klute_sim.envs.base.single import SINGLE_MASK, DeviceEnv, Observation, Step
from klute_sim.envs.base.task import make_action_space, make_observation_space
from klute_sim.envs.tasks.instruments import OBSERVATIONS
from klute_sim.envs.tasks.options import resolve_device
from klute_sim.envs.tasks.walk.options import WalkTaskOptions
from klute_sim.envs.tasks.walk.person import WalkingPerson
from klute_sim.envs.tasks.walk.task import WalkTask
from klute_sim.errors import SimulationError
from klute_sim.gait.spring_foot import SpringFoot
from klute_sim.plant import callbacks
from klute_sim.rendering.frames import DEFAULT_CAMERA, RenderOptions
from klute_sim.types import Array
from klute_sim.walker.person.build import Prosthesis


def resolve_prosthesis(
    device: Device | str | Path, foot: str | None, alignment: float | None, spring_foot: float | None
) -> Prosthesis:
    """Return the prosthesis with a ``device``, or with a ``spring_foot`` [N*m/deg]; ``alignment`` is in rad."""
    return Prosthesis(
        device=resolve_device(device, foot),
        spring_foot=None if spring_foot is None else SpringFoot(stiffness=math.degrees(spring_foot)),
        alignment=alignment,
    )


def resolve_base(base: Controller | str) -> Controller:
    """Return the base controller, from its specification if it is a string."""
    return parse_controller(base) if isinstance(base, str) else base


class AnkleWalkEnv(DeviceEnv):
    """A person with a powered below-knee prosthesis who walks by muscles and reflexes, as with ``klute-sim walk``.

    Nothing prescribes motion or load: what the prosthesis does changes speed, steps, effort and falls. The reflexes
    are those of walkers that have adapted to the default state machine and do not adapt to the policy, so every walk
    is acute: a planar model of what happens before the person adapts.

    ## Action space

    ``Box(-1, 1, (1,), float32)``, held for 10 ms. Values outside are clipped; NaN and infinity are refused. The rate
    limit of the regulator acts on the command. The keyword ``action`` selects the meaning:

    | action | meaning |
    |---|---|
    | ``pressure`` | gauge pressure, from 0 (-1) to the supply pressure (1) |
    | ``residual`` | change of the pressure of the ``base`` controller, from -residual_bar (-1) to residual_bar (1) |

    The default is ``pressure``. Most pressures throw a walker within three seconds, so ``residual`` is the easier
    problem. The base controller, ``machine`` by default, has the sensors of the observation with their noise and delay.
    With ``residual`` an action of 0 is the walk of ``klute-sim walk``, bit for bit, unless sensors are noisy or late.

    ## Observation space

    ``Box((8,), float32)``: what the prosthesis senses, clipped to the bounds; the table is that of
    :class:`klute_sim.envs.ankle_gait.AnkleGaitEnv`:

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

    ``sensor_noise`` multiplies the typical standard deviation (0: no noise), ``sensor_delay`` is the delay in whole
    intervals. The phase is the time since the last foot strike of the prosthesis over the duration of the stride
    before, at 1 kHz from the load cell; it has no noise.

    ## Reward

    The reward is the sum of these terms, each in ``info``. All weights are assumed; the keyword ``reward`` replaces
    some, as in ``{"effort": -0.2}``.

    | term | value |
    |---|---|
    | ``reward_survival`` | 1 for every interval walked |
    | ``reward_effort`` | -0.1 times the metabolic power over mass and target ``speed`` [J/kg/m], mean of both laws |
    | ``reward_speed`` | -3 e², e = error of the speed in m/s, limited to 0.4 |
    | ``reward_symmetry`` | -3 a², a = asymmetry (left - right)/(left + right) of the last two steps, limited to 0.3 |
    | ``reward_smoothness`` | -0.05 times the squared change of the action |
    | ``reward_fall`` | -10 for a fall, which has no other term |

    ``info`` also holds ``pressure_command_bar`` and what a prosthesis does not sense, for critics that may know more
    than the policy: ``speed_m_per_s``, ``rise_m_per_s``, ``hip_height_m``, ``trunk_lean_rad``,
    ``trunk_rate_rad_per_s``, angles and rates of the joints of both legs (``hip_left_rad``, ...,
    ``knee_rate_right_rad_per_s``), ``load_left_bw``, ``load_right_bw``, ``step_asymmetry`` and
    ``metabolic_cost_j_per_kg_m``.

    ## Episode

    An episode starts with a right heel strike about to come, from the initial state of the walker. It is truncated
    after ``duration`` seconds and terminated by a fall (hip below 0.65 m, or trunk inclined by more than 57 degrees),
    when a state is not finite, and when the mean speed over two seconds is below 0.5 m/s: standing counts as a fall.

    ## Randomisation

    | keyword | samples at every reset | in ``info`` of the reset |
    |---|---|---|
    | ``walkers`` | one of these shipped walkers or files | ``walker_index`` |
    | ``gain_noise`` | gains of both legs, each times 1 + gain_noise x standard normal | |
    | ``unevenness`` | one of 16 grounds with blocks of up to this height [m] | ``ground_seed`` |

    Without ``walkers`` these are all shipped walkers that have adapted to the device with the default state machine,
    or, if there are none, to any device with it; with a ``spring_foot`` those that have adapted to one.

    ## Versions

    * v0: first version.
    """

    def __init__(
        self,
        *,
        device: Device | str | Path = DEFAULT_DEVICE,
        foot: str | None = None,
        alignment: float | None = None,
        spring_foot: float | None = None,
        action: str = "pressure",
        base: Controller | str = "machine",
        residual_bar: float = 1.0,
        walkers: Sequence[str | Path] | None = None,
        gain_noise: float = 0.0,
        unevenness: float = 0.0,
        speed: float = 1.25,
        duration: float = 20.0,
        time_step: float = 1e-3,
        sensor_noise: float = 0.0,
        sensor_delay: int = 0,
        reward: Mapping[str, float] | None = None,
        backend: str = "auto",
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str = DEFAULT_CAMERA,
    ) -> None:
        """Create the environment of a person with a ``device`` (preset, path or Device).

        ``foot`` is the foot below the ankle, such as ``"sach"`` (None: that of the device), and ``alignment`` [rad] the
        angle of the prosthesis to the limb (None: that of the device). ``spring_foot`` [N*m/deg] replaces the device,
        so that the actions have no effect: a baseline. ``base`` is a controller or its specification, ``speed`` the
        target [m/s]; ``duration`` [s], ``time_step`` [s]; ``backend`` is auto, compiled or python. With the
        ``render_mode`` human, rgb_array or depth_array it draws, from a ``camera`` of the model (side, corner,
        prosthesis_close), images of ``width`` and ``height`` [pixels]. The class docstring describes the other options.

        Raises InputError when an option is invalid.
        """
        render_options = RenderOptions(render_mode=render_mode, width=width, height=height, camera=camera)
        options = WalkTaskOptions(
            prosthesis=resolve_prosthesis(device, foot, alignment, spring_foot),
            base=resolve_base(base),
            action=action,
            residual_bar=residual_bar,
            walkers=walkers,
            gain_noise=gain_noise,
            unevenness=unevenness,
            speed=speed,
            duration=duration,
            time_step=time_step,
            sensor_noise=sensor_noise,
            sensor_delay=sensor_delay,
            reward=reward,
        )
        super().__init__(options.actions_per_episode, render_options)
        self._backend = callbacks.choose_backend(backend)
        self._task = WalkTask(options, 1, self._backend)
        self.action_space, self.observation_space = make_action_space(), make_observation_space(OBSERVATIONS)

    @property
    def data(self) -> mujoco.MjData:
        """Return the state of the simulation, after the first reset."""
        return self._person.simulator.data

    @property
    def model(self) -> mujoco.MjModel:
        """Return the MuJoCo model of the person, after the first reset; on uneven ground resets change it."""
        return self._person.simulator.model

    @property
    def _person(self) -> WalkingPerson:
        return self._task.get_person(0)

    def _start_episode(self) -> tuple[Observation, dict[str, Any]]:
        with callbacks.device_callbacks(self._backend, is_isolated=True):
            info = self._task.start_episode(0, self.np_random)
        self._task.reset(SINGLE_MASK, [self.np_random])
        return self._task.observations[0], dict(info)

    def _advance(self, action: Array) -> Step:
        self._task.set_actions(action, SINGLE_MASK)
        # A failed device ends the episode, because its state is not finite.
        with suppress(SimulationError), callbacks.device_callbacks(self._backend, is_isolated=True):
            self._person.advance()
        step = self._task.evaluate(action, SINGLE_MASK, [self.np_random])
        reward, terminated, truncated = float(step.reward[0]), bool(step.terminated[0]), bool(step.truncated[0])
        return self._task.observations[0], reward, terminated, truncated, step.get_first_info()

    def _get_simulation(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        return self.model, self.data
