"""Walks on a cluster, by Ray; an optional extra, imported when it is used.

Ray hands out the walks and begins those again whose process or machine was lost. Results come back to the process
that asked, so the machines need klute-sim and no common disk.
"""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any

from klute_sim.errors import InputError, KluteSimError, MissingExtraError
from klute_sim.sweep.plan import Combination
from klute_sim.sweep.runner import TRIES, Finished
from klute_sim.sweep.walk import walk

MOST_ASKED = 1000
"""Walks that Ray is asked for at a time: enough for as many cores, and for it to see what it has to wait for."""


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """Ray, connected to the cluster at ``address``; ``auto``: to the one it finds, ``local``: to one it starts here.

    Raises MissingExtraError without Ray and InputError if nothing answers.
    """
    try:
        import ray
    except ImportError:
        raise MissingExtraError("a sweep on a cluster", "ray") from None
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # what is walked here is nobody else's business
    try:
        ray.init(address, log_to_driver=False, logging_level="error")
    except (OSError, ValueError, RuntimeError) as error:
        reason = str(error).strip().splitlines()[0].rstrip(".") if str(error).strip() else type(error).__name__
        raise InputError(f"no Ray cluster at '{address}': {reason}") from None
    try:
        yield ray
    finally:
        ray.shutdown()


def run(combinations: Iterable[Combination], finished: Finished, ray: Any) -> None:
    """Walk ``combinations`` where ``ray`` is connected to, and tell ``finished`` as they are done."""
    task = ray.remote(num_cpus=1, max_retries=TRIES - 1)(walk)
    waiting, asked = iter(combinations), dict[Any, Combination]()
    while True:
        asked |= {task.remote(combination): combination for combination in islice(waiting, MOST_ASKED - len(asked))}
        if not asked:
            return
        done, _ = ray.wait(list(asked), num_returns=1)
        combination = asked.pop(done[0])
        try:
            walked = ray.get(done[0])
        except ray.exceptions.RayTaskError as error:
            if not isinstance(error.cause, MemoryError):
                raise _told(error.cause) from None
            walked = None
        except ray.exceptions.RayError:  # the process or its machine was lost, every time
            walked = None
        finished(combination, walked)


def _told(cause: BaseException) -> KluteSimError:
    """What a walk raised elsewhere; anything but an error of ours means that it could not even begin."""
    if isinstance(cause, KluteSimError):
        return cause
    reason = (str(cause).strip().splitlines() or [""])[0]
    return KluteSimError(f"a machine of the cluster cannot walk ({type(cause).__name__}: {reason}): it needs klute-sim")
