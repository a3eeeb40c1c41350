"""Evaluate cases in processes on the cores of this machine."""

import multiprocessing
import os
import pickle
import signal
import sys
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
from klute_sim.parameter_sweep.evaluate import Case, CaseResult, evaluate_case
from klute_sim.parameter_sweep.runner import MAX_ATTEMPTS, ResultCallback
from klute_sim.plant import callbacks

_TERMINATION_SIGNALS = {getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)}


class LocalRunner:
    """Worker processes that evaluate cases; a context manager whose end, also by an error, ends the processes."""

    def __init__(self, n_jobs: int = 0) -> None:
        """Use at most ``n_jobs`` processes (0: one per core), each started when it is needed."""
        self._n_jobs, self._workers = n_jobs or count_cores(), list[_Worker]()

    def __enter__(self) -> "LocalRunner":
        """Compile the device model once, before the processes start."""
        callbacks.choose_backend()  # also warns once if it cannot be compiled
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes."""
        for worker in self._workers:
            worker.close()

    def run(self, cases: Iterable[Case], on_result: ResultCallback) -> None:
        """Evaluate ``cases`` and report each result to ``on_result``.

        A process that is killed costs only its own case, which is attempted :data:`MAX_ATTEMPTS` times in all.
        """
        queue = deque(cases)
        while len(self._workers) < min(self._n_jobs, len(queue)):
            self._workers.append(_Worker())
        idle, running = list(self._workers), dict[Future[CaseResult], tuple[_Worker, Case]]()
        n_killed: Counter[str] = Counter()
        while queue or running:
            while queue and idle:
                worker, case = idle.pop(), queue.popleft()
                with _block_interrupts():
                    running[worker.submit(case)] = worker, case
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                worker, case = running.pop(future)
                idle.append(worker)
                result: CaseResult | None = None
                try:
                    result = future.result()
                except (BrokenProcessPool, MemoryError):  # Linux kills a process that asks for too much memory
                    n_killed[case.key] += 1
                    if n_killed[case.key] < MAX_ATTEMPTS:
                        queue.append(case)
                        continue
                on_result(case, result)


def count_cores() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextmanager
def _block_interrupts() -> Iterator[None]:
    """Block the signals that end this process in this context, and in processes started in it until their start-up.

    Without support of the system the context does nothing.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    previous_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, *_TERMINATION_SIGNALS})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous_mask)


@contextmanager
def _hide_main_script(case: Case) -> Iterator[None]:
    """Start a process in this context without running the user's script in it, unless ``case`` refers to the script.

    A spawned process imports the main script again. A script without ``if __name__ == "__main__"`` would then start
    its own processes, and so on.
    """
    main = sys.modules["__main__"]
    hidden = () if b"__main__" in pickle.dumps(case) else ("__file__", "__spec__")
    original = {name: vars(main)[name] for name in hidden if name in vars(main)}
    vars(main).update(dict.fromkeys(original))
    try:
        yield
    finally:
        vars(main).update(original)


class _Worker:
    """A pool of one process, so that a broken pool identifies its case and leaves the other processes alone."""

    def __init__(self) -> None:
        self._start()

    def _start(self) -> None:
        child_pipe, self._parent_pipe = multiprocessing.Pipe(duplex=False)
        context = multiprocessing.get_context("spawn")
        self._pool = ProcessPoolExecutor(1, context, initializer=_initialize_worker, initargs=(child_pipe,))

    def submit(self, case: Case) -> Future[CaseResult]:
        with _hide_main_script(case):
            try:
                return self._pool.submit(evaluate_case, case)
            except BrokenProcessPool:  # killed during the previous case, or since then
                self.close()
                self._start()
                return self._pool.submit(evaluate_case, case)

    def close(self) -> None:
        """End the process, also in the middle of a case."""
        self._parent_pipe.close()
        self._pool.shutdown(cancel_futures=True)


def _initialize_worker(parent_pipe: Connection) -> None:
    """Prepare a new process: it ignores Ctrl-C, uses one thread, and ends when ``parent_pipe`` is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches every process; the parent ends the others
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _TERMINATION_SIGNALS)
    warnings.simplefilter("ignore", KluteSimWarning)  # the parent has issued them
    threadpool_limits(1, user_api="blas")  # each core evaluates its own case
    threading.Thread(target=_exit_with_parent, args=(parent_pipe,), daemon=True).start()


def _exit_with_parent(parent_pipe: Connection) -> None:
    """End this process when its parent ends, even if the parent is killed."""
    try:
        parent_pipe.recv_bytes()
    except EOFError:
        os._exit(1)
