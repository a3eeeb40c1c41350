"""Import of optional dependencies."""

from types import ModuleType

from klute_sim.errors import MissingExtraError


def import_pandas(feature: str) -> ModuleType:
    """Return the package pandas; raises MissingExtraError, which names ``feature``, when it is not installed."""
    try:
        import pandas
    except ImportError:
        raise MissingExtraError(feature, "tables") from None
    return pandas
