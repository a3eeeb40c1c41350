"""How the process of a command ends: by a signal, by its exit code, and with output that nobody can take."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import NoReturn, TextIO

import click

from klute_sim.errors import make_printable

_TERMINATION_SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, name)
)

REPETITION_DELAY_S = 0.1
"""Time until a signal is sent again whose exception was lost [s]."""
_MEMORY_MESSAGES = (
    *("failed to map segment", "cannot allocate memory", "could not allocate memory", "out of memory"),
    "can't start new thread",
)
"""Parts of the messages of errors that mean a lack of memory, in small letters."""


class TerminationError(KeyboardInterrupt):
    """A signal asks the process to end; like Ctrl-C it lets the process remove unfinished files."""

    def __init__(self, number: int) -> None:
        """Report the signal of this ``number``."""
        super().__init__()
        self.signal_number = number


@contextmanager
def raise_on_termination() -> Iterator[None]:
    """In this context raise TerminationError when a signal ends the process; the user can have it ignored (nohup)."""
    handled = [number for number in _TERMINATION_SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    previous = {number: signal.signal(number, _raise_termination) for number in handled}
    previous_hook = sys.unraisablehook

    def repeat_swallowed(unraisable: "sys.UnraisableHookArgs") -> None:
        """Send a signal again whose exception was lost in a callback, such as those of the compiler."""
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            previous_hook(unraisable)
            return
        for number in handled:
            signal.signal(number, _raise_termination)
        lost = getattr(unraisable.exc_value, "signal_number", signal.SIGINT)
        timer = threading.Timer(REPETITION_DELAY_S, _signal_main_thread, (lost,))
        timer.daemon = True
        timer.start()

    sys.unraisablehook = repeat_swallowed
    try:
        yield
    finally:
        sys.unraisablehook = previous_hook
        for number, handler in previous.items():
            signal.signal(number, handler)


def _signal_main_thread(number: int) -> None:
    """Send the signal to the main thread, which it also wakes where the system supports that."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(threading.main_thread().ident or 0, number)
    else:
        signal.raise_signal(number)


def _raise_termination(number: int, frame: FrameType | None) -> NoReturn:
    for other in _TERMINATION_SIGNALS:
        signal.signal(other, signal.SIG_IGN)  # a second one must not stop the removal of unfinished files
    raise TerminationError(number)


def find_interrupt(error: BaseException) -> KeyboardInterrupt | None:
    """Return the interrupt that is the cause of ``error``; None without one.

    An extension module whose import is interrupted, such as that of MuJoCo, fails with an ImportError. An error while
    an interrupt is handled is an error of its own.
    """
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, KeyboardInterrupt):
        cause = cause.__cause__
    return cause


def get_exit_code(interrupt: BaseException) -> int:
    """Return the exit code that a shell expects after ``interrupt``."""
    return 128 + (interrupt.signal_number if isinstance(interrupt, TerminationError) else signal.SIGINT)


def is_lack_of_memory(error: BaseException) -> bool:
    """Return whether ``error`` means that there is not enough memory, for data, for code or for a thread."""
    return isinstance(error, MemoryError) or any(text in str(error).lower() for text in _MEMORY_MESSAGES)


def exit_process(code: int, message: str = "") -> NoReturn:
    """Print ``message`` on stderr if there is one, and exit with ``code``.

    Output that cannot be written is discarded, because Python would try it again at its end, and then complain.
    """
    if message:
        with suppress(OSError):
            click.echo(make_printable(f"klute-sim: {message}"), err=True)
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:  # the caller has closed it
            _discard_unwritable(stream)
    sys.exit(code)


def _discard_unwritable(stream: TextIO) -> None:
    """Flush ``stream``, to nowhere if that fails."""
    try:
        stream.flush()
    except (OSError, ValueError):
        with suppress(OSError, ValueError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, stream.fileno())
            os.close(null)
