"""Walks on the cores of this machine."""

import multiprocessing
import os
import signal
import threading
import warnings
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import Connection

from threadpoolctl import threadpool_limits

from klute_sim.errors import KluteSimWarning
from klute_sim.parameter_sweep.evaluate import CaseResult, evaluate_case
from klute_sim.parameter_sweep.plan import GaitCase
from klute_sim.parameter_sweep.runner import MAX_ATTEMPTS, ResultCallback
from klute_sim.plant import callbacks


class LocalRunner:
    """Processes of this machine that walk combinations, until the context that they were made in ends.

    Whatever ends that early, an interrupt or an error, ends the processes as well.
    """

    def __init__(self, n_jobs: int = 0) -> None:
        """``jobs`` processes (0: one per core), begun as they are needed."""
        self._n_jobs, self._workers = n_jobs or count_cores(), list[_Worker]()

    def __enter__(self) -> "LocalRunner":
        """See the class."""
        callbacks.choose_backend()  # compiled once here rather than in every process; and says if it cannot be
        return self

    def __exit__(self, *_: object) -> None:
        """See the class."""
        for process in self._workers:
            process.close()

    def run(self, cases: Iterable[GaitCase], on_result: ResultCallback) -> None:
        """Walk ``combinations`` and tell ``finished`` as they are done.

        A process that is killed costs its own walk and no other: that one is begun again, :data:`TRIES` times in all.
        """
        waiting = deque(cases)
        while len(self._workers) < min(self._n_jobs, len(waiting)):
            self._workers.append(_Worker())
        idle, running = list(self._workers), dict[Future[CaseResult], tuple[_Worker, GaitCase]]()
        lost: Counter[str] = Counter()
        while waiting or running:
            while waiting and idle:
                process, combination = idle.pop(), waiting.popleft()
                with _block_interrupts():
                    running[process.submit(combination)] = process, combination
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                process, combination = running.pop(future)
                idle.append(process)
                try:
                    walked = future.result()
                except (BrokenProcessPool, MemoryError):  # the one is how Linux answers the other
                    lost[combination.key] += 1
                    if lost[combination.key] < MAX_ATTEMPTS:
                        waiting.append(combination)
                        continue
                    walked = None
                on_result(combination, walked)


def count_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """Ctrl-C is held back meanwhile, and processes begun in here never hear of it; where the system can do that."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Worker:
    """A pool of one process: if it breaks, it is known which combination it had, and the others go on."""

    def __init__(self) -> None:
        self._start()

    def _start(self) -> None:
        theirs, self._parent_pipe = multiprocessing.Pipe(duplex=False)
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(1, context, initializer=_initialize_worker, initargs=(theirs,))

    def submit(self, case: GaitCase) -> Future[CaseResult]:
        try:
            return self._pool.submit(evaluate_case, case)
        except BrokenProcessPool:  # killed during the walk before this one, or since
            self.close()
            self._start()
            return self._pool.submit(evaluate_case, case)

    def close(self) -> None:
        """End the process, whatever it is doing."""
        self._parent_pipe.close()
        self._pool.shutdown(cancel_futures=True)


def _initialize_worker(parent_pipe: Connection) -> None:
    """Make a fresh process ready to walk, and to end when the other end of ``lifeline`` is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process; the first one ends the others
    warnings.simplefilter("ignore", KluteSimWarning)  # said once, by the first process
    threadpool_limits(1, user_api="blas")  # every core has a walk of its own
    threading.Thread(target=_exit_with_parent, args=(parent_pipe,), daemon=True).start()


def _exit_with_parent(parent_pipe: Connection) -> None:
    """End this process with the one that began it, even if that was killed and could not say so."""
    try:
        parent_pipe.recv_bytes()
    except EOFError:
        os._exit(1)
