"""Run mutated files through their readers, and judge how each ends, how long it takes and how much memory it needs."""

import os
import random
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from benchmarks.robustness import byte_mutations, file_kinds
from benchmarks.robustness.value_mutations import VALUE_MUTATIONS

from klute_sim.errors import KluteSimError

MAX_SECONDS = 30
"""Time limit of a case [s]."""
MAX_MEGABYTES = 1000.0
"""Limit of the memory of a process for one case [MB]."""
MAX_MESSAGE_LENGTH = 2000
"""Longest message that counts as a sentence [letters]."""
WRITING_EVENTS = ("open", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.symlink", "os.link")
"""Audit events that may change the file system."""


class TimeLimitError(BaseException):
    """A case exceeded its time limit; no reader catches it."""


@dataclass
class ChunkResult:
    """Result of successive cases of one kind."""

    count: int = 0
    """Number of cases."""
    refused: int = 0
    """Number of files that were refused in one sentence; the others were read."""
    failures: dict[int, str] = field(default_factory=dict)
    """Number of the case -> what went wrong."""
    slowest_seconds: float = 0.0
    """Duration of the slowest case [s]."""
    peak_megabytes: float = 0.0
    """Largest memory that a process needs for one case [MB]."""

    def add(self, other: "ChunkResult") -> None:
        """Add the cases of ``other``."""
        self.count += other.count
        self.refused += other.refused
        self.failures |= other.failures
        self.slowest_seconds = max(self.slowest_seconds, other.slowest_seconds)
        self.peak_megabytes = max(self.peak_megabytes, other.peak_megabytes)


def mutate(content: bytes, rng: random.Random, kind: file_kinds.Kind, suffix: str) -> bytes:
    """Return ``content`` with a mutation of its values, or with one to three random damages of its bytes."""
    if suffix in VALUE_MUTATIONS and rng.random() < 0.4:
        return VALUE_MUTATIONS[suffix](content, rng)
    is_text = kind.text and suffix not in (".parquet", ".npz", ".mat")
    mutations = byte_mutations.TEXT_MUTATIONS if is_text else byte_mutations.BINARY_MUTATIONS
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        content = rng.choice(mutations)(content, rng)
    return content


def run_case(kind: file_kinds.Kind, originals: Sequence[Path], number: int, scratch: Path) -> tuple[bool, str]:
    """Mutate one file as ``number`` determines, and read all; return whether it was refused, and the failure or ''."""
    rng = random.Random(f"{kind.name} {number}")
    copies = []
    chosen = rng.randrange(len(originals))
    for position, file in enumerate(originals):
        content = file.read_bytes()
        copy = scratch / file.name
        copy.write_bytes(mutate(content, rng, kind, file.suffix) if position == chosen else content)
        copies.append(copy)
    signal.alarm(MAX_SECONDS)
    try:
        kind.use(copies)
    except KluteSimError as error:
        return True, _judge_message(str(error))
    except TimeLimitError:
        return False, f"more than {MAX_SECONDS} s: {traceback.format_exc(limit=-4)}"
    except Exception:
        return False, traceback.format_exc(limit=-4)
    finally:
        signal.alarm(0)
    return False, ""


def _judge_message(text: str) -> str:
    is_sentence = text.strip() and text.isprintable() and len(text) <= MAX_MESSAGE_LENGTH
    return "" if is_sentence else f"no sentence: {text[:300]!r}"


def run_cases(
    name: str, first: int, count: int, keep: Path | None = None, report: Callable[[int], object] = lambda number: None
) -> ChunkResult:
    """Run ``count`` cases from ``first`` in this process; ``report`` receives each number before it is run.

    ``keep`` is a folder for the files of failures.
    """
    kind, result = file_kinds.KINDS[name], ChunkResult()
    signal.signal(signal.SIGALRM, _raise_time_limit)
    with TemporaryDirectory() as folder:
        intact, scratch = Path(folder) / "intact", Path(folder) / "scratch"
        intact.mkdir()
        originals = kind.make(intact)
        _run_intact(kind, originals, scratch)
        intact_megabytes = _read_memory("VmRSS")
        for number in range(first, first + count):
            scratch.mkdir()
            report(number)
            _reset_peak()
            # Libraries keep memory from case to case (rerun some 9 MB per recording), which a command does not have.
            kept_megabytes = _read_memory("VmRSS") - intact_megabytes
            children = _measure_children()
            start = time.perf_counter()
            with watch_writes(Path(folder)) as writes:
                refused, failure = run_case(kind, originals, number, scratch)
            seconds, megabytes = time.perf_counter() - start, _measure_peak() - kept_megabytes
            if _measure_children() > children:  # such as the process that reads C3D
                megabytes = max(megabytes, _measure_children())
            if megabytes > MAX_MEGABYTES:
                failure += f"\nmore than {MAX_MEGABYTES:g} MB: {megabytes:.0f} MB"
            failure = "\n".join(filter(None, [failure, *writes])).strip()
            result.add(ChunkResult(1, int(refused), {number: failure} if failure else {}, seconds, megabytes))
            if failure and keep is not None:
                scratch.rename(keep / f"{name}_{number}")
            else:
                _remove(scratch)
    return result


def _run_intact(kind: file_kinds.Kind, originals: Sequence[Path], scratch: Path) -> None:
    """Read the intact files, which must work, and compiles what is compiled."""
    scratch.mkdir()
    copies = [scratch / file.name for file in originals]
    for file, copy in zip(originals, copies, strict=True):
        copy.write_bytes(file.read_bytes())
    kind.use(copies)
    _remove(scratch)


def _remove(folder: Path) -> None:
    for file in sorted(folder.rglob("*"), reverse=True):
        file.rmdir() if file.is_dir() and not file.is_symlink() else file.unlink()
    folder.rmdir()


def _raise_time_limit(*_: object) -> None:
    raise TimeLimitError


def _reset_peak() -> None:
    """Begin a new peak of the memory (Linux; elsewhere the peak of the process counts)."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _measure_peak() -> float:
    """Return the peak of the memory of this process [MB]."""
    return _read_memory("VmHWM") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000.0


def _read_memory(name: str) -> float:
    """Return a figure of the memory of this process by its name in Linux [MB], and 0 elsewhere."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) / 1000.0
    return 0.0


def _measure_children() -> float:
    """Return the peak of the memory of the child processes so far [MB]."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1000.0


@contextmanager
def watch_writes(scratch: Path) -> Iterator[list[str]]:
    """Record files that are opened for writing, created or removed outside of ``scratch``."""
    writes: list[str] = []
    allowed = (str(scratch.resolve()), os.devnull, "/proc/self")
    is_active = True

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if not is_active or event not in WRITING_EVENTS:
            return
        if event == "open" and not (isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)):
            return
        path = arguments[0]
        if isinstance(path, str | bytes):
            place = os.path.abspath(os.fsdecode(path))
            if not place.startswith(allowed) and "__pycache__" not in place:  # Python's own, at a first import
                writes.append(f"{event} {place}")

    sys.addaudithook(hook)
    try:
        yield writes
    finally:
        is_active = False
