"""PEtab Select searches the sets of effects: forward, and FAMoS (Gabel et al. 2019, PLoS Comput Biol 15:e1007230).

PEtab Select (https://petab-select.readthedocs.io) chooses the models to compare and when to end; each model is
calibrated with the simulator and the least squares of the package and compared by the textbook BIC, which is that of
PEtab's independent noise. An effect is one parameter that is 0 or estimated; all parameters of the effect are
calibrated then, and count in the BIC.
"""

import math
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.hidden_effects.baselines.calibration import MAX_EFFECTS, Calibration, compute_bic
from benchmarks.hidden_effects.baselines.trials import Trials, Verdict

PETAB_PROBLEM = """format_version: 1
parameter_file: parameters.tsv
problems:
- {condition_files: [], measurement_files: [], observable_files: [], sbml_files: []}
"""
"""PEtab problem without a model, because the simulator is that of the package."""


def search_forward(trials: Trials, exclude: Sequence[str]) -> Verdict:
    """Return the best set of effects that the forward search finds, which adds one effect in each iteration."""
    return _search(trials, exclude, "forward")


def search_famos(trials: Trials, exclude: Sequence[str]) -> Verdict:
    """Return the best set of effects that FAMoS finds, which adds, removes and swaps effects."""
    return _search(trials, exclude, "famos")


def _search(trials: Trials, exclude: Sequence[str], method: str) -> Verdict:
    with Calibration(trials, exclude) as calibration:
        switches = {f"effect_{index}": term for index, term in enumerate(calibration.select_switches())}

        def compute_criterion(names: Sequence[str]) -> float:
            fit = calibration.fit([switches[name] for name in names]) if len(names) <= MAX_EFFECTS else None
            return math.inf if fit is None else compute_bic(fit)

        names = find_best_set(tuple(switches), method, compute_criterion)
        best = calibration.fit([switches[name] for name in names])
        assert best is not None  # its BIC is finite
        return calibration.describe(best)


def find_best_set(
    names: Sequence[str], method: str, compute_criterion: Callable[[Sequence[str]], float]
) -> tuple[str, ...]:
    """Return the best set of ``names`` that PEtab Select finds by ``method``, ``forward`` or ``famos``.

    ``compute_criterion`` returns the BIC of a set; an infinite one excludes it. Swaps of FAMoS continue while they
    help, because version 0.4.0 does not end otherwise after all neighbours of the best set are known.
    """
    from petab_select import Criterion, Problem, ui

    if not names:
        return ()
    arguments: dict[str, Any] = (
        {"max_steps": 1} if method == "forward" else {"swap_parameter_sets": [[*names]], "consecutive_laterals": True}
    )
    with tempfile.TemporaryDirectory() as folder:
        space_file = _write_model_space(Path(folder), names)
        problem = Problem(
            criterion=Criterion.BIC,
            method=method,
            model_space_files=[space_file],
            candidate_space_arguments=arguments,
        )
        candidate_space, ends = None, False
        while not ends:
            iteration = ui.start_iteration(problem=problem, candidate_space=candidate_space)
            models = iteration["uncalibrated_models"]
            for model in models:
                model.set_criterion(Criterion.BIC, compute_criterion(model.get_estimated_parameter_ids()))
            result = ui.end_iteration(
                problem=problem, candidate_space=iteration["candidate_space"], calibrated_models=models
            )
            candidate_space, ends = result["candidate_space"], result["terminate"]
        best = ui.get_best(problem=problem, models=problem.state.models)
    return tuple(best.get_estimated_parameter_ids())


def _write_model_space(folder: Path, names: Sequence[str]) -> Path:
    """Write a model space in which each of ``names`` is 0 or estimated; return its file."""
    parameters = ["parameterId\tparameterScale\tlowerBound\tupperBound\tnominalValue\testimate"]
    parameters += [f"{name}\tlin\t0\t1\t0\t0" for name in names]
    head = "\t".join(["model_subspace_id", "model_subspace_petab_yaml", *names])
    row = "\t".join(["effects", "problem.yaml", *["0;estimate"] * len(names)])
    (folder / "parameters.tsv").write_text("\n".join(parameters) + "\n", "utf-8")
    (folder / "problem.yaml").write_text(PETAB_PROBLEM, "utf-8")
    (folder / "space.tsv").write_text(f"{head}\n{row}\n", "utf-8")
    return folder / "space.tsv"
