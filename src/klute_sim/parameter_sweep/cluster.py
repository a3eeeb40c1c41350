"""Evaluate cases on a Ray cluster; Ray is an optional extra and is imported when it is used.

Ray distributes the cases and restarts those whose process or machine is lost. Results return to this process, so the
machines need klute-sim but no shared disk.
"""

import os
import socket
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from itertools import islice
from typing import Any

from klute_sim.errors import InputError, KluteSimError, MissingExtraError
from klute_sim.parameter_sweep.evaluate import Case, CaseResult, evaluate_case
from klute_sim.parameter_sweep.fingerprint import describe_difference, fingerprint_software
from klute_sim.parameter_sweep.runner import MAX_ATTEMPTS, ResultCallback

RAY_ADDRESS_KEYWORDS = ("auto", "local")
"""Keywords that Ray accepts in place of an address."""
CONNECT_TIMEOUT_S = 5.0
"""Maximum time that an address may take to answer [s]."""
MAX_PENDING_TASKS = 1000
"""Maximum number of cases submitted to Ray at a time: enough for as many cores, and for Ray to plan ahead."""


@contextmanager
def connect(address: str) -> Iterator[Any]:
    """Yield Ray, connected to the cluster at ``address``.

    ``auto`` connects to the cluster that Ray finds, ``local`` to one that it starts on this machine. Output of Ray goes
    to stderr.

    Raises MissingExtraError when Ray is not installed, InputError when no cluster answers, and KluteSimError when a
    node of the cluster runs other software than this process.
    """
    try:
        import ray
    except ImportError:
        raise MissingExtraError("a run on a cluster", "ray") from None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # no usage statistics leave this machine
    try:
        _check_reachable(address)
        ray.init(address, log_to_driver=False, logging_level="error")
    except (OSError, ValueError, RuntimeError) as error:
        raise InputError(f"no Ray cluster at '{address}': {_first_line(error)}") from None
    with redirect_stdout(sys.stderr):  # Ray reports on its workers, and stdout is for results
        try:
            _check_nodes(ray)
            yield ray
        finally:
            ray.shutdown()


def _check_reachable(address: str) -> None:
    """Raise OSError or ValueError when nothing listens at ``address``: Ray itself would retry for a long time."""
    if address in RAY_ADDRESS_KEYWORDS:
        return
    host, _, port = address.rpartition("://")[2].rpartition(":")
    if not host or not port.isdigit():
        raise ValueError("an address is HOST:PORT")
    socket.create_connection((host, int(port)), timeout=CONNECT_TIMEOUT_S).close()


def _check_nodes(ray: Any) -> None:
    """Raise KluteSimError unless all nodes run the software of this process.

    Nodes that join the cluster later are checked with each case.
    """
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    def report_software() -> dict[str, str]:
        # Nested, so that Ray sends its code, and imported from the installation of the node, which may be any version.
        import klute_sim

        try:
            from klute_sim.parameter_sweep.fingerprint import fingerprint_software
        except ImportError:
            return {"klute-sim": klute_sim.__version__}
        return fingerprint_software()

    task = ray.remote(num_cpus=0, max_retries=0)(report_software)
    nodes = [node for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU")]
    strategies = [NodeAffinitySchedulingStrategy(node["NodeID"], soft=False) for node in nodes]
    reports = [task.options(scheduling_strategy=strategy).remote() for strategy in strategies]
    for node, report in zip(nodes, reports, strict=True):
        try:
            difference = describe_difference(ray.get(report), fingerprint_software())
        except ray.exceptions.RayTaskError as error:
            difference = _first_line(error.cause)
        except ray.exceptions.RayError:  # the node was lost meanwhile, so it runs no case
            continue
        if difference:
            raise KluteSimError(
                f"the node '{node['NodeManagerHostname']}' at {node['NodeManagerAddress']} runs other software than "
                f"this process ({difference}): install the same klute-sim on every machine of the cluster"
            )


def run_on_cluster(cases: Iterable[Case], on_result: ResultCallback, ray: Any) -> None:
    """Evaluate ``cases`` on the cluster that ``ray`` is connected to, and report each result to ``on_result``."""
    task = ray.remote(num_cpus=1, max_retries=MAX_ATTEMPTS - 1)(evaluate_case)
    remaining, pending = iter(cases), dict[Any, Case]()
    while True:
        pending |= {task.remote(case): case for case in islice(remaining, MAX_PENDING_TASKS - len(pending))}
        if not pending:
            return
        ready, _ = ray.wait(list(pending), num_returns=1)
        case = pending.pop(ready[0])
        result: CaseResult | None = None
        try:
            result = ray.get(ready[0])
        except ray.exceptions.RayTaskError as error:
            if not isinstance(error.cause, MemoryError):
                raise _to_klute_sim_error(error.cause) from None
        except ray.exceptions.RayError:  # the process or its machine was lost in every attempt
            pass
        on_result(case, result)


def _to_klute_sim_error(cause: BaseException) -> KluteSimError:
    """Return the error of a worker as one of this package; any other error means that the worker could not start."""
    if isinstance(cause, KluteSimError):
        return cause
    return KluteSimError(f"a machine of the cluster cannot simulate ({_first_line(cause)}): install klute-sim there")


def _first_line(error: BaseException) -> str:
    """Return the first line of the message of ``error``; messages of Ray have many."""
    message = getattr(error, "strerror", None) or str(error).strip() or type(error).__name__
    if message.startswith("Version mismatch"):  # of Ray or Python: the lines are the versions
        message = " ".join(message.split())
    return message.splitlines()[0].rstrip(".")
