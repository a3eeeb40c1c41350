"""Walks on a cluster, by Ray; an optional extra, imported when it is used.

Ray hands out the walks and begins those again whose process or machine was lost. Results come back to the process
that asked, so the machines need klute-sim and no common disk.
"""

import os
import socket
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from itertools import islice
from typing import Any

from klute_sim.errors import InputError, KluteSimError, MissingExtraError
from klute_sim.parameter_sweep.evaluate import evaluate_case
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.parameter_sweep.runner import MAX_ATTEMPTS, ResultCallback

RAY_ADDRESS_KEYWORDS = ("auto", "local")
"""Words in place of an address."""
CONNECT_TIMEOUT_S = 5.0
"""How long an address may take to answer [s]."""
MAX_PENDING_TASKS = 1000
"""Walks that Ray is asked for at a time: enough for as many cores, and for it to see what it has to wait for."""


@contextmanager
def connect(address: str) -> Iterator[Any]:
    """Ray, connected to the cluster at ``address``; ``auto``: to the one it finds, ``local``: to one it starts here.

    Whatever Ray prints meanwhile goes to stderr. Raises MissingExtraError without Ray, InputError if nothing answers.
    """
    try:
        import ray
    except ImportError:
        raise MissingExtraError("a sweep on a cluster", "ray") from None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # what is walked here is nobody else's business
    try:
        _check_reachable(address)
        ray.init(address, log_to_driver=False, logging_level="error")
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(f"no Ray cluster at '{address}': {_first_line(error)}") from None
    with redirect_stdout(sys.stderr):  # it prints what happens to its workers, among the results
        try:
            yield ray
        finally:
            ray.shutdown()


def _check_reachable(address: str) -> None:
    """Raise OSError or ValueError where nobody listens: Ray itself would go on trying for a long time."""
    if address in RAY_ADDRESS_KEYWORDS:
        return
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not host or not port.isdigit():
        raise ValueError("an address is HOST:PORT")
    socket.create_connection((host, int(port)), timeout=CONNECT_TIMEOUT_S).close()


def run_on_cluster(cases: Iterable[GaitCase], on_result: ResultCallback, ray: Any) -> None:
    """Walk ``combinations`` where ``ray`` is connected to, and tell ``finished`` as they are done."""
    task = ray.remote(num_cpus=1, max_retries=MAX_ATTEMPTS - 1)(evaluate_case)
    waiting, asked = iter(cases), dict[Any, GaitCase]()
    while True:
        asked |= {
            task.remote(combination): combination for combination in islice(waiting, MAX_PENDING_TASKS - len(asked))
        }
        if not asked:
            return
        done, _ = ray.wait(list(asked), num_returns=1)
        combination = asked.pop(done[0])
        try:
            walked = ray.get(done[0])
        except ray.exceptions.RayTaskError as error:
            if not isinstance(error.cause, MemoryError):
                raise _to_klute_sim_error(error.cause) from None
            walked = None
        except ray.exceptions.RayError:  # the process or its machine was lost, every time
            walked = None
        on_result(combination, walked)


def _to_klute_sim_error(cause: BaseException) -> KluteSimError:
    """What a walk raised elsewhere; anything but an error of ours means that it could not even begin."""
    if isinstance(cause, KluteSimError):
        return cause
    return KluteSimError(f"a machine of the cluster cannot walk ({_first_line(cause)}): it needs klute-sim")


def _first_line(error: BaseException) -> str:
    """What ``error`` says first: Ray's own say much."""
    said = getattr(error, "strerror", None) or str(error).strip() or type(error).__name__
    return said.splitlines()[0].rstrip(".")
