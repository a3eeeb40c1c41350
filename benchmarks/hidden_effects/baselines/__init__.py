"""Other methods that identify a missing effect on the same datasets under the same rules.

    python -m benchmarks.hidden_effects.baselines METHOD DATASET [--exclude NAME]

Every method is a function of the prepared trials and the names that it must not consider, and returns the entries of
``verdict.json`` that are scored: the verdict, effects, alternatives, and the gap on the test trials.
"""

import argparse
import importlib
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.hidden_effects.baselines.trials import Verdict, load_trials

from klute_sim.errors import InputError

INSTALL_HINT = (
    "install it with 'pip install --group benchmark' (pip 25.1 or later) or 'uv pip install --group benchmark'"
)


class Method(NamedTuple):
    """Where a method is implemented, and what it needs."""

    module: str
    """Module of this package."""
    function: str
    """Function of the module."""
    requirement: tuple[str, str, str] | None = None
    """Name of a package, its module, and an attribute that the module has where it is complete."""


METHODS = {
    "plain_bic": Method("plain_bic", "select_by_bic"),
    "petab_forward": Method("petab_search", "search_forward", ("PEtab Select", "petab_select", "ui")),
    "petab_famos": Method("petab_search", "search_famos", ("PEtab Select", "petab_select", "ui")),
    "sysid_bic": Method("sysid_bic", "select_by_sysid", ("mujoco-core[sysid]", "mujoco.sysid", "optimize")),
    "sindy": Method("sindy", "regress_sparsely", ("PySINDy", "pysindy", "optimizers")),
    "holdout_f_test": Method("holdout_f_test", "search_on_holdout"),
    "gp_discrepancy": Method("gp_discrepancy", "predict_discrepancy", ("scikit-learn", "sklearn", "__version__")),
}
"""Name -> method, in the order of the tables."""


def list_missing_packages(methods: Sequence[str] = tuple(METHODS)) -> list[str]:
    """Return the packages that ``methods`` need and that are not installed."""
    requirements = dict.fromkeys(r for name in methods if (r := METHODS[name].requirement))
    return [package for package, module, attribute in requirements if not _is_installed(module, attribute)]


def _is_installed(module: str, attribute: str) -> bool:
    try:
        return hasattr(importlib.import_module(module), attribute)
    except ModuleNotFoundError:
        return False


def require_packages(methods: Sequence[str] = tuple(METHODS)) -> None:
    """Raise ModuleNotFoundError with installation advice if a package that ``methods`` need is missing."""
    missing = list_missing_packages(methods)
    if missing:
        raise ModuleNotFoundError(f"{', '.join(missing)} not found: {INSTALL_HINT}")


def run_method(name: str, folder: Path, exclude: Sequence[str] = ()) -> Verdict:
    """Return the verdict of the method ``name`` on the dataset in ``folder``.

    Effects in ``exclude`` are not considered. Data that cannot be read make the verdict ``insufficient-data``. Raises
    ModuleNotFoundError where a package is missing.
    """
    require_packages([name])
    method = METHODS[name]
    function = getattr(importlib.import_module(f"{__name__}.{method.module}"), method.function)
    try:
        answer: Verdict = function(load_trials(folder), exclude)
    except InputError as error:
        answer = {"verdict": "insufficient-data", "effects": [], "reasons": [str(error)]}
    return {"alternatives": [], "gap": {}, **answer}


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the verdict of a method as one JSON object."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden_effects.baselines", description=__doc__)
    parser.add_argument("method", choices=tuple(METHODS))
    parser.add_argument("dataset", type=Path, help="folder of the dataset")
    parser.add_argument("--exclude", action="append", default=[], metavar="NAME", help="may be repeated")
    options = parser.parse_args(arguments)
    try:
        verdict = run_method(options.method, options.dataset, options.exclude)
    except ModuleNotFoundError as error:
        print(error, file=sys.stderr)
        return 1
    json.dump(verdict, sys.stdout, indent=1)
    return 0
