"""Errors of the environments: sentences of this package that are also the errors of Gymnasium."""

import gymnasium

from klute_sim.errors import InputError, KluteSimError


class ResetNeededError(InputError, gymnasium.error.ResetNeeded):
    """A step or a picture was requested without an episode."""


class ClosedEnvError(InputError, gymnasium.error.ClosedEnvironmentError):
    """A closed environment was used."""


class InvalidActionError(InputError, gymnasium.error.InvalidAction):
    """An action has a wrong shape or type, or is not finite."""


class InvalidSeedError(InputError, gymnasium.error.Error):
    """A seed is not None and not a whole number from 0."""


class ConcurrentUseError(KluteSimError):
    """Two threads use one environment at the same time."""
