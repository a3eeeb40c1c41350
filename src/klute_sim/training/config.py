"""The configuration of a training: a TOML file."""

import inspect
import tomllib
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError

from klute_sim.envs.ankle_gait_vector import AnkleGaitVectorEnv
from klute_sim.errors import InputError

EXCLUDED_KEYWORDS = ("self", "num_envs", "autoreset_mode", "render_mode")
"""Keywords of the batch that are no part of the task."""


class TrainingConfig(BaseModel):
    """What is trained, in which environment, how; validated when made."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    algorithm: Literal["ppo", "sac"]
    num_envs: Annotated[int, Field(ge=1, le=4096)]
    hidden: Annotated[list[Annotated[int, Field(ge=1, le=4096)]], Field(min_length=1, max_length=8)]
    activation: Literal["tanh", "relu"]
    checkpoint_minutes: Annotated[FiniteFloat, Field(gt=0)]
    evaluation_episodes: Annotated[int, Field(ge=2, le=4096)]
    environment: dict[str, Any] = {}
    """Keywords of the environment."""
    ppo: dict[str, Any] = {}
    """Keywords of the algorithm; likewise ``sac``."""
    sac: dict[str, Any] = {}

    @property
    def algorithm_options(self) -> dict[str, Any]:
        """Keywords of the chosen algorithm."""
        return dict(getattr(self, self.algorithm))


def read_default_config() -> bytes:
    """The shipped file."""
    return (resources.files("klute_sim.training") / "default.toml").read_bytes()


def load_config(path: str | Path | None) -> tuple[TrainingConfig, bytes]:
    """The configuration in a file (None: the shipped one), and its bytes; raises InputError with what is wrong."""
    if path is None:
        return parse_config(read_default_config(), "default.toml"), read_default_config()
    try:
        content = Path(path).read_bytes()
    except OSError as error:
        raise InputError(f"configuration {path} cannot be read: {error.strerror}") from None
    return parse_config(content, str(path)), content


def parse_config(content: bytes, source: str) -> TrainingConfig:
    """The configuration that ``content`` (TOML, UTF-8) is; ``where`` names its place in errors."""
    try:
        found = TrainingConfig.model_validate(tomllib.loads(content.decode("utf-8-sig")))
    except UnicodeDecodeError:
        raise InputError(f"configuration {source} cannot be read: not a UTF-8 text file") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"configuration {source} is not valid TOML: {error}") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        raise InputError(f"configuration {source}: {key}: {first['msg'][0].lower()}{first['msg'][1:]}") from None
    known = [
        name for name in inspect.signature(AnkleGaitVectorEnv.__init__).parameters if name not in EXCLUDED_KEYWORDS
    ]
    for name in found.environment:
        if name not in known:
            raise InputError(f"configuration {source}: the environment has no '{name}'; allowed: {', '.join(known)}")
    return found
