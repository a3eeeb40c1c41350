"""Configuration of a training: a TOML file."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from klute_sim.controllers.learned import BASES
from klute_sim.errors import InputError
from klute_sim.files.limits import TRAINING_CONFIG
from klute_sim.files.reading import read_bytes
from klute_sim.files.toml import format_toml, parse_toml, validation_sentence
from klute_sim.gait.reference import load_reference
from klute_sim.training.environments import TRAINING_ENVIRONMENTS, TrainingEnvironment

EXCLUDED_KEYWORDS = ("num_envs", "autoreset_mode", "max_episode_steps", "render_mode")
"""Keywords of the vector environment that a configuration cannot set."""
TOML_TYPES: Mapping[Any, tuple[str, tuple[type, ...]]] = {
    str: ("a string", (str,)),
    int: ("a whole number", (int,)),
    float: ("a number", (float, int)),
    Collection: ("a list", (list,)),
    Sequence: ("a list", (list,)),
    Mapping: ("a table", (dict,)),
}
"""Type of a keyword -> words for it, and the types of TOML values that the keyword accepts."""


class TrainingConfig(BaseModel):
    """Algorithm, policy and environment of a training, validated at construction."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    env: Literal["gait", "walk", "joint"] = "gait"
    """Environment, one of :data:`klute_sim.training.environments.TRAINING_ENVIRONMENTS`."""
    algorithm: Literal["ppo", "sac"]
    """Algorithm of Stable-Baselines3."""
    num_envs: Annotated[int, Field(ge=1, le=4096)]
    """Number of parallel environments."""
    hidden: Annotated[list[Annotated[int, Field(ge=1, le=4096)]], Field(min_length=1, max_length=8)]
    """Number of neurons of each hidden layer."""
    activation: Literal["tanh", "relu"]
    """Activation function of the hidden layers."""
    checkpoint_minutes: Annotated[FiniteFloat, Field(gt=0)]
    """Time between two checkpoints [min]."""
    evaluation_episodes: Annotated[int, Field(ge=2, le=4096)]
    """Number of episodes of the evaluation."""
    environment: dict[str, Any] = {}
    """Keywords of the environment."""
    reference_sha256: str | None = None
    """Digest of the reference that the environment names, set when a training starts; another file is refused."""
    ppo: dict[str, Any] = {}
    """Keywords of the algorithm PPO."""
    sac: dict[str, Any] = {}
    """Keywords of the algorithm SAC."""

    @property
    def training_environment(self) -> TrainingEnvironment:
        """Return the selected environment."""
        return TRAINING_ENVIRONMENTS[self.env]

    @property
    def algorithm_options(self) -> dict[str, Any]:
        """Return the keywords of the selected algorithm."""
        return dict(getattr(self, self.algorithm))


def read_default_config(env: str = "gait") -> bytes:
    """Return the content of the default configuration file of the environment ``env``."""
    return (resources.files("klute_sim.training") / TRAINING_ENVIRONMENTS[env].config_file).read_bytes()


def load_config(path: str | Path | None, env: str | None = None) -> tuple[TrainingConfig, bytes]:
    """Return the configuration of a file and its content.

    ``path`` None is the default configuration of ``env``, or of the gait. Raises InputError when the configuration is
    invalid or belongs to another environment than ``env``.
    """
    if path is None:
        name = env or "gait"
        content = read_default_config(name)
        return parse_config(content, TRAINING_ENVIRONMENTS[name].config_file), content
    content = read_bytes(path, TRAINING_CONFIG)
    config = parse_config(content, str(path))
    if env not in (None, config.env):
        raise InputError(
            f"configuration {path} has env = '{config.env}', and '{env}' is asked for: leave one of them out"
        )
    return config, content


def load_subject_config(
    path: str | Path | None, subject: Mapping[str, Any], env: str | None = None
) -> tuple[TrainingConfig, bytes]:
    """Return the configuration of a file (None: the default of ``env``) and its content, for a ``subject``.

    ``subject`` holds keywords of the environment, which replace those of the file. The path of a reference becomes
    absolute, and the digest of its curves is part of the configuration, so that a training resumes with the same gait.

    Raises InputError when the configuration is invalid or the reference cannot be read.
    """
    config, content = load_config(path, env)
    environment = {**config.environment, **subject}
    reference = environment.get("reference")
    if not subject and reference is None:
        return config, content
    _check_keywords(config.env, subject, "the subject")
    changes: dict[str, Any] = {"environment": environment}
    if reference is not None:
        changes["reference_sha256"] = compute_reference_digest(environment)
        environment["reference"] = str(Path(reference).absolute())
    config = config.model_copy(update=changes)
    return config, format_toml(config.model_dump(exclude_none=True)).encode()


def compute_reference_digest(environment: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the reference in the keywords ``environment``; raises InputError when it cannot be read."""
    if "reference" not in environment:
        raise InputError("the training has a 'reference_sha256', but its [environment] names no reference; add it")
    return load_reference(environment["reference"], accept=environment.get("accept", ())).digest


def parse_config(content: bytes, source: str) -> TrainingConfig:
    """Return the configuration in ``content`` (TOML, UTF-8); ``source`` names it in errors.

    Raises InputError when the content is invalid.
    """
    try:
        config = TrainingConfig.model_validate(parse_toml(content, f"configuration {source}"))
    except ValidationError as error:
        raise InputError(f"configuration {source}: {validation_sentence(error, TrainingConfig)}") from None
    _check_keywords(config.env, config.environment, f"configuration {source}")
    _check_types(config.env, config.environment, f"configuration {source}")
    base = config.environment.get("base", "machine")
    if base not in BASES:
        raise InputError(f"configuration {source}: base is '{base}'; allowed: {', '.join(BASES)}")
    return config


def _check_keywords(env: str, keywords: Iterable[str], source: str) -> None:
    """Raise InputError when the environment ``env`` lacks one of the ``keywords``, which come from ``source``."""
    known = _collect_keyword_types(env)
    for name in keywords:
        if name not in known:
            raise InputError(f"{source}: the environment '{env}' takes no '{name}'; allowed: {', '.join(known)}")


def _check_types(env: str, values: Mapping[str, Any], source: str) -> None:
    """Raise InputError when one of the ``values`` of keywords of the environment ``env`` has a wrong type."""
    keyword_types = _collect_keyword_types(env)
    for name, value in values.items():
        names, types = zip(*(TOML_TYPES[keyword_type] for keyword_type in keyword_types[name]), strict=True)
        if isinstance(value, bool) or not isinstance(value, sum(types, ())):
            raise InputError(f"{source}: {name} = {value!r} is refused; allowed: {' or '.join(names)}")


def _collect_keyword_types(env: str) -> dict[str, list[Any]]:
    """Return keyword -> types among :data:`TOML_TYPES`, for the keywords of ``env`` that a file can set."""
    keyword_types = {}
    for name, annotation in get_type_hints(TRAINING_ENVIRONMENTS[env].make_envs.__init__).items():
        alternatives = [annotation, get_origin(annotation)]
        for alternative in get_args(annotation):
            alternatives += [alternative, get_origin(alternative)]
        allowed = [alternative for alternative in alternatives if alternative in TOML_TYPES]
        if allowed and name not in EXCLUDED_KEYWORDS:
            keyword_types[name] = allowed
    return keyword_types
