"""The base exception: whatever a user can do wrong ends in one sentence: what, where, what is allowed."""


class KluteSimError(Exception):
    """Base of all errors this package raises on purpose; its message is one sentence for the user."""


class InputError(KluteSimError):
    """A value, key, column or file given by the user is not usable."""


class MissingExtraError(KluteSimError):
    """An optional dependency is needed for what was asked and is not installed."""

    def __init__(self, what: str, extra: str) -> None:
        """``what`` was asked for; ``extra`` would bring it."""
        super().__init__(f"{what} needs the optional extra '{extra}': pip install '.[{extra}]' in the project's folder")


class SimulationError(KluteSimError):
    """A simulation left the region where its result means anything (NaN, divergence)."""


class KluteSimWarning(UserWarning):
    """Something works, but not as well as it could."""
