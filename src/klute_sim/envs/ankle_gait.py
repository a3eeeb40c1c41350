"""``klute_sim/AnkleGait-v0``: walk a powered ankle on the gait rig, one pressure command every 10 ms."""

from dataclasses import fields
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from klute_sim.device.files import DEFAULT_PROSTHESIS, Device, load
from klute_sim.envs.task import INTERVAL, OBSERVATIONS, Readings, Task
from klute_sim.errors import InputError, SimulationError
from klute_sim.plant import router
from klute_sim.rigs.gait.assembly import DRIVES, Assembly, GaitOptions, assemble, start
from klute_sim.units import BAR

Observation = NDArray[np.float32]
MOST_NOISE = 0.3
"""[rad]"""
MOST_PIXELS = 4096


def rig_for(device: Device | str | Path, options: GaitOptions) -> Assembly:
    """The rig, commanded at the environment's interval; raises InputError if that is no number of steps."""
    each = round(INTERVAL / options.step)
    if abs(each * options.step - INTERVAL) > 1e-12:
        raise InputError(f"step is {1e3 * options.step:g} ms; allowed: what divides {1e3 * INTERVAL:g} ms evenly")
    return assemble(device if isinstance(device, Device) else load(device), options, INTERVAL)


def observation_space() -> "spaces.Box[np.float32]":
    """What a prosthesis can sense."""
    low, high = (np.array([row[k] for row in OBSERVATIONS], dtype=np.float32) for k in (2, 3))
    return spaces.Box(low, high, dtype=np.float32)


def action_space() -> "spaces.Box[np.float32]":
    """Pressure, from none (-1) to all that the supply has (1)."""
    return spaces.Box(-1.0, 1.0, (1,), np.float32)


class AnkleGaitEnv(gymnasium.Env[Observation, NDArray[np.float32]], gymnasium.utils.EzPickle):
    """A powered below-knee prosthesis on the gait rig of ``klute-sim gait``.

    The residual limb follows measured human gait and the reference's load is applied to it; the policy commands the
    pressure of the artificial muscle and is rewarded for an ankle that moves and pushes like the human one.

    ## Action space

    ``Box(-1, 1, (1,), float32)``, held for 10 ms: commanded gauge pressure from 0 (-1) to the supply's pressure (+1);
    for a device whose valve takes openings, the opening from exhaust (-1) to fill (+1).
    What is beyond is clipped; NaN is refused. The regulator's own limits (rate) act after that.

    ## Observation space

    ``Box((8,), float32)``: what a prosthesis can sense, without noise, clipped to the bounds.

    | # | observation | unit | low | high |
    |---|---|---|---|---|
    | 0 | ankle angle, dorsiflexion positive | rad | -1 | 1 |
    | 1 | ankle velocity, dorsiflexion positive | rad/s | -50 | 50 |
    | 2 | shank inclination, forward positive | rad | -3.2 | 3.2 |
    | 3 | shank angular velocity, forward positive | rad/s | -50 | 50 |
    | 4 | axial load in the pylon, compression positive | body weights | -5 | 5 |
    | 5 | gauge pressure | bar | 0 | 20 |
    | 6 | sine of the estimated gait phase | 1 | -1 | 1 |
    | 7 | cosine of the estimated gait phase | 1 | -1 | 1 |

    The phase is estimated as the prosthesis could: time since the last foot strike (load above 0.1 body weights) over
    the time between the last two.

    ## Reward

    The sum of these terms, each in ``info``:

    | term | value |
    |---|---|
    | ``reward_moment`` | 0.4 exp(-d²/2), d = distance of the net ankle moment from the human one, in 0.2 N·m/kg |
    | ``reward_angle`` | 0.3 exp(-d²/2), d in 5 degrees |
    | ``reward_power`` | 0.3 exp(-d²/2), d in 0.5 W/kg |
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

    ## Versions

    * v0: first version.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": round(1.0 / INTERVAL)}  # noqa: RUF012

    def __init__(
        self,
        *,
        device: Device | str | Path = DEFAULT_PROSTHESIS,
        mass: float = 75.0,
        stature: float = 1.75,
        speed: float | None = None,
        strides: int = 5,
        step: float = 5e-4,
        law: str = "auto",
        reset_noise: float = 0.02,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
    ) -> None:
        """For a ``device`` (preset, file or Device), a subject (kg, m, m/s), ``step`` [s] and ``reset_noise`` [rad].

        ``law`` is one of :data:`klute_sim.device.installation.LAWS`. Raises InputError for what cannot be.
        """
        gymnasium.utils.EzPickle.__init__(**locals())
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise InputError(f"render_mode is '{render_mode}'; allowed: None, rgb_array")
        options = GaitOptions(mass=mass, stature=stature, speed=speed, strides=strides, step=step)
        self._rig = rig_for(device, options)
        self.model = self._rig.model
        """The MuJoCo model, with the device in it."""
        self.data = mujoco.MjData(self.model)
        """The simulation."""
        self.render_mode = render_mode
        self.action_space, self.observation_space = action_space(), observation_space()
        self._law, self._reset_noise = router.choose(law), noise_of(reset_noise)
        self._task, self._one = Task(self._rig, 1, self._law), np.ones(1, dtype=np.bool_)
        if not (0 < width <= MOST_PIXELS and 0 < height <= MOST_PIXELS):
            raise InputError(f"pictures are {width} x {height}; allowed: 1 to {MOST_PIXELS} pixels a side")
        self._size = (height, width)
        self.model.vis.global_.offwidth = max(width, self.model.vis.global_.offwidth)
        self.model.vis.global_.offheight = max(height, self.model.vis.global_.offheight)
        self._renderer: mujoco.Renderer | None = None

    @property
    def dt(self) -> float:
        """Time between two actions [s]."""
        return INTERVAL

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Heel strike; there are no ``options``."""
        super().reset(seed=seed)
        begin(self._rig, self.data, self.np_random, self._reset_noise)
        now = self._readings()
        self._task.begin(self._one, now)
        return self._task.observe(now)[0], {}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold ``action`` for one interval; raises InputError if it is no number."""
        chosen = checked(action, (1,))
        self.data.ctrl[: len(DRIVES)] = self._task.slopes()[0]
        with router.installed(self._law):
            try:
                for steps, asked in self._task.due(self._task.command(chosen), self._one):
                    self.data.ctrl[self._rig.actuator.ctrl] = asked[0]
                    router.step(self.model, self.data, steps)
            except SimulationError:
                self.data.act[self._rig.actuator.act] = np.nan  # under either law, a failed device ends the episode
        now = self._readings()
        reward, terminated, truncated, told = self._task.judge(chosen, now, self._one)
        info = {name: float(value[0]) for name, value in told.items()}
        return self._task.observe(now)[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def _readings(self) -> Readings:
        d = self.data
        return Readings(*(getattr(d, field.name)[None] for field in fields(Readings)))

    def render(self) -> NDArray[np.uint8] | None:
        """The leg from its side, (height, width, 3); None without a render mode."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            self._renderer = mujoco.Renderer(self.model, *self._size)
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


def noise_of(reset_noise: float) -> float:
    """``reset_noise`` [rad]; raises InputError if no ankle could be there."""
    if not 0.0 <= reset_noise <= MOST_NOISE:
        raise InputError(f"reset_noise is {reset_noise:g}; allowed: 0 to {MOST_NOISE:g} rad")
    return reset_noise


def begin(rig: Assembly, data: mujoco.MjData, random: np.random.Generator, noise: float) -> None:
    """Put ``data`` at the beginning of an episode."""
    pressure = random.uniform(0.0, 0.25 * rig.actuator.parameters.supply.pressure)
    start(rig, data, pressure, random.uniform(-noise, noise))
    data.ctrl[rig.actuator.ctrl] = 0.0 if rig.actuator.parameters.supply.opens != 0.0 else pressure / BAR


def checked(
    action: NDArray[np.floating[Any]], shape: tuple[int, ...], counts: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """The action as numbers, 0 in rows that do not count; raises InputError for another shape, or NaN where it does."""
    chosen = np.array(action, dtype=np.float64)
    if chosen.shape != shape:
        raise InputError(f"action has shape {chosen.shape}; allowed: {shape}")
    if counts is not None:
        chosen[~counts] = 0.0
    if np.isnan(chosen).any():
        raise InputError("action is not a number; allowed: -1 to 1")
    return chosen
