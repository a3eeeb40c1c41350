"""``klute_sim/AntagonistJoint`` on all cores: one model, many simulations, and no Python between their steps."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from gymnasium.vector import AutoresetMode

from klute_sim.device.device import Device
from klute_sim.envs.antagonist_joint import (
    DEFAULT_JOINT_DEVICE,
    resolve_devices,
)
from klute_sim.envs.base.scheduled import ScheduledTaskVectorEnv
from klute_sim.envs.base.vector import VectorOptions
from klute_sim.envs.tasks.joint_randomization import JointRanges
from klute_sim.envs.tasks.joint_task import JointOptions, JointTask
from klute_sim.plant import callbacks
from klute_sim.rendering.frames import DEFAULT_CAMERA


class AntagonistJointVectorEnv(ScheduledTaskVectorEnv):
    """``num_envs`` environments of :class:`klute_sim.envs.antagonist_joint.AntagonistJointEnv`, stepped together.

    ``gymnasium.make_vec("klute_sim/AntagonistJoint-v0", num_envs=64, vectorization_mode="vector_entry_point")``

    Spaces, reward and episodes equal those of the single environment bit for bit, with any number of threads:
    environment *i* behaves as a single one with seed ``seed + i``.
    """

    def __init__(
        self,
        num_envs: int = 1,
        *,
        device: Device | str | Path | Mapping[str, Device | str | Path] = DEFAULT_JOINT_DEVICE,
        duration: float = 5.0,
        time_step: float = 5e-4,
        load: float | None = None,
        domain_randomization: JointRanges | Mapping[str, Any] | None = None,
        n_jobs: int = 0,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        width: int = 480,
        height: int = 480,
        camera: str = DEFAULT_CAMERA,
    ) -> None:
        """Create the environments on ``n_jobs`` threads (0: all cores); raises InputError when an option is invalid.

        ``max_episode_steps`` truncates episodes earlier, as in ``gymnasium.make``.
        :class:`klute_sim.envs.antagonist_joint.AntagonistJointEnv` describes the other options.
        """
        vector_options = VectorOptions(
            num_envs=num_envs,
            n_jobs=n_jobs,
            autoreset_mode=autoreset_mode,
            max_episode_steps=max_episode_steps,
            render_mode=render_mode,
            width=width,
            height=height,
            camera=camera,
        )
        options = JointOptions(
            duration=duration,
            time_step=time_step,
            load=load,
            ranges=JointRanges.from_mapping(domain_randomization),
        )
        super().__init__(
            JointTask(resolve_devices(device), options, num_envs, callbacks.choose_backend()), vector_options
        )
