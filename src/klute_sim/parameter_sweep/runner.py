"""The interface of case runners, which simulate cases on the cores of this machine or on a cluster."""

from collections.abc import Callable, Iterable
from typing import Any

from klute_sim.parameter_sweep.evaluate import CaseResult

MAX_ATTEMPTS = 3
"""Maximum number of attempts at a case whose process is killed."""

ResultCallback = Callable[[Any, CaseResult | None], None]
"""Receives each finished case and its result; None: its process was killed in every attempt."""

Runner = Callable[[Iterable[Any], ResultCallback], None]
"""Evaluates cases in any order and reports each one to the callback."""
