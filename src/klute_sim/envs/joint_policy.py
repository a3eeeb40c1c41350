"""Learned baseline of ``klute_sim/AntagonistJoint``: a policy of ``klute-sim train --env joint``."""

from importlib import resources
from pathlib import Path

from klute_sim.controllers.policy import Policy, load_policy
from klute_sim.envs.tasks.joint_task import OBSERVATIONS, TENDONS
from klute_sim.errors import InputError

JOINT_ENVIRONMENT = "klute_sim/AntagonistJoint"
"""Beginning of the name of the environment."""


def load_joint_policy(path: str | Path | None = None) -> Policy:
    """Return the policy in a file of ``klute-sim train --env joint``; None: the learned baseline of the package.

    It needs NumPy alone. Called with an observation (6,), it returns the actions (2,), and (n, 2) for (n, 6).

    Raises InputError when the file is not a policy, or one of another environment.
    """
    if path is None:
        with resources.as_file(resources.files("klute_sim.envs") / "joint_policy.npz") as shipped:
            return load_joint_policy(shipped)
    policy = load_policy(path)
    name = str(policy.metadata.get("environment", "an unknown environment"))
    shape = len(policy.observation_scale), len(policy.layers[-1][1])
    if not name.startswith(JOINT_ENVIRONMENT) or shape != (len(OBSERVATIONS), len(TENDONS)):
        raise InputError(
            f"policy {path} was trained for {name} and has {shape[0]} inputs and {shape[1]} outputs; allowed: "
            f"policies of {JOINT_ENVIRONMENT}, with {len(OBSERVATIONS)} and {len(TENDONS)}: klute-sim train --env joint"
        )
    return policy
