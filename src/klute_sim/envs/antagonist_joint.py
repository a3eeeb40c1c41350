"""``klute_sim/AntagonistJoint-v0``: control of the angle of a joint with the pressures of two muscles."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from klute_sim.device.device import Device
from klute_sim.envs.base.scheduled import ScheduledTaskEnv
from klute_sim.envs.tasks.joint_randomization import JointRanges
from klute_sim.envs.tasks.joint_task import TENDONS, JointOptions, JointTask
from klute_sim.envs.tasks.options import resolve_device
from klute_sim.errors import InputError, suggest
from klute_sim.plant import callbacks
from klute_sim.rendering.frames import DEFAULT_CAMERA, RenderOptions

DEFAULT_JOINT_DEVICE = "klute-3-4-pair"
"""Default device on both tendons."""


def resolve_devices(device: "Device | str | Path | Mapping[str, Device | str | Path]") -> dict[str, Device]:
    """Return tendon -> device; raises InputError for a tendon that the joint lacks or that gets no device."""
    if not isinstance(device, Mapping):
        return dict.fromkeys(TENDONS, resolve_device(device))
    for name in (*device, *TENDONS):
        if name not in TENDONS or name not in device:
            listing = f"give one device, or one for each of: {', '.join(TENDONS)}"
            raise InputError(f"the tendon '{name}' has no device or does not exist; {suggest(name, TENDONS, listing)}")
    return {name: resolve_device(device[name]) for name in TENDONS}


class AntagonistJointEnv(ScheduledTaskEnv):
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
    pressure (0 for a device that takes valve openings); the target leads away from there in half a second. With
    ``domain_randomization`` load and devices are drawn, too, and ``info`` of the reset holds them. It is
    truncated after ``duration`` seconds and terminated when a state is not finite.

    ## Versions

    * v0: first version.
    """

    def __init__(
        self,
        *,
        device: Device | str | Path | Mapping[str, Device | str | Path] = DEFAULT_JOINT_DEVICE,
        duration: float = 5.0,
        time_step: float = 5e-4,
        load: float | None = None,
        domain_randomization: JointRanges | Mapping[str, Any] | None = None,
        backend: str = "auto",
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str = DEFAULT_CAMERA,
    ) -> None:
        """Create the environment with a ``device`` (preset, path or Device) on both tendons, or one for each.

        ``duration`` [s] of an episode, ``time_step`` [s], ``load`` at the end of the lever [kg] (None: 1);
        ``domain_randomization`` gives ranges (``load_kg``, ``device``, ``effects``) from which each episode draws, for
        each device on its own; ``backend`` is auto, compiled or python. With the ``render_mode`` human, rgb_array or
        depth_array it draws, from a ``camera`` of the model (side), images of ``width`` and ``height`` [pixels]. Raises
        InputError when an option is invalid.
        """
        options = JointOptions(
            duration=duration,
            time_step=time_step,
            load=load,
            ranges=JointRanges.from_mapping(domain_randomization),
        )
        chosen_backend = callbacks.choose_backend(backend)
        render_options = RenderOptions(render_mode=render_mode, width=width, height=height, camera=camera)
        super().__init__(JointTask(resolve_devices(device), options, 1, chosen_backend), chosen_backend, render_options)
