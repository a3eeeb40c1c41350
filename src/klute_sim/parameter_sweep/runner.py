"""What walks combinations, wherever it does: on the cores of this machine or on a cluster."""

from collections.abc import Callable, Iterable

from klute_sim.parameter_sweep.evaluate import CaseResult
from klute_sim.parameter_sweep.plan import GaitCase

MAX_ATTEMPTS = 3
"""How often a combination is begun whose process is killed, before it is given up."""

ResultCallback = Callable[[GaitCase, CaseResult | None], None]
"""Told each combination when it is done; None: its process was killed every time."""

Runner = Callable[[Iterable[GaitCase], ResultCallback], None]
"""Walks combinations and tells of each; in any order."""
