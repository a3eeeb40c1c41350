"""Checks of what a caller passes to an environment: actions, seeds and options of a reset."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from klute_sim.envs.base.errors import InvalidActionError, InvalidSeedError
from klute_sim.errors import InputError, suggest
from klute_sim.types import Array, Mask

MAX_SEED_DIGITS = 100
"""Maximum number of digits of a seed; a seed of Gymnasium has 39."""


def validate_action(action: ArrayLike, shape: tuple[int, ...], mask: Mask | None = None) -> Array:
    """Return ``action`` as float64, with 0 outside ``mask``.

    Raises InvalidActionError when shape or type are wrong, or when a number is not finite.
    """
    try:
        numbers = np.asarray(action)
    except ValueError:  # nested lists of unequal length
        numbers = np.asarray(None)
    if numbers.dtype.kind not in "iuf":
        kind = numbers.dtype if numbers.dtype != object else type(action).__name__
        raise InvalidActionError(f"action has type {kind}; allowed: an array of numbers, shape {shape}")
    if numbers.shape != shape:
        raise InvalidActionError(f"action has shape {numbers.shape}; allowed: {shape}")
    valid_action = numbers.astype(np.float64)
    if mask is not None:
        valid_action[~mask] = 0.0
    if not np.isfinite(valid_action).all():
        raise InvalidActionError(
            f"action contains {valid_action[~np.isfinite(valid_action)][0]:g}; allowed: finite numbers, of which those "
            "beyond -1 and 1 are clipped"
        )
    return valid_action


def validate_reset_options(options: Mapping[str, Any] | None, allowed: Sequence[str] = ()) -> Mapping[str, Any]:
    """Return the ``options`` of a reset, {} for None; raises InputError for another type or an unknown key."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise InputError(f"options of reset is of type {type(options).__name__}; allowed: None or a dictionary")
    for key in options:
        if key not in allowed:
            hint = f"allowed: {', '.join(allowed)}" if allowed else "it takes none; options belong into gymnasium.make"
            raise InputError(f"reset has no option {key!r}; {suggest(str(key), allowed, hint)}")
    return options


def validate_seed(seed: Any) -> int | None:
    """Return ``seed`` as an int or None; raises InvalidSeedError for anything but None and whole numbers from 0."""
    if seed is None:
        return None
    if isinstance(seed, bool | np.bool_) or not isinstance(seed, int | np.integer):
        raise InvalidSeedError(f"seed is of type {type(seed).__name__}; allowed: None or a whole number from 0")
    if not 0 <= seed < 10**MAX_SEED_DIGITS:
        raise InvalidSeedError(
            f"seed is {'negative' if seed < 0 else 'too long'}; allowed: None or a whole number from 0, up to "
            f"{MAX_SEED_DIGITS} digits"
        )
    return int(seed)


def validate_seeds(seed: Any, count: int) -> list[int | None]:
    """Return one seed for each of ``count`` environments: ``seed + i`` of one number, or the numbers of a sequence.

    Raises InvalidSeedError when there is another number of seeds, or when one is invalid.
    """
    if seed is None or not isinstance(seed, Sequence | np.ndarray) or isinstance(seed, str | bytes):
        first = validate_seed(seed)
        return [None if first is None else first + i for i in range(count)]
    if len(seed) != count:
        raise InvalidSeedError(f"seed has {len(seed)} values; allowed: one value, or {count}")
    return [validate_seed(value) for value in seed]


def validate_reset_mask(value: Any, count: int) -> Mask:
    """Return the ``reset_mask`` of ``count`` environments; raises InputError when it is none."""
    mask = np.asarray(value)
    if mask.shape != (count,) or mask.dtype != np.bool_ or not mask.any():
        raise InputError(
            f"reset_mask has shape {mask.shape} and type {mask.dtype}; allowed: ({count},) and bool, with at least one "
            "to reset"
        )
    return mask.copy()


def validate_count(name: str, value: Any, lowest: int) -> int:
    """Return ``value`` as an int; raises InputError unless it is a whole number from ``lowest``."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < lowest:
        raise InputError(f"{name} is {value!r}; allowed: a whole number from {lowest}")
    return int(value)
