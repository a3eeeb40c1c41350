"""Fuzzing: files with random damage are read as by a command; each must be read, or refused in one sentence.

    python -m tests.fuzz                                   # 10 000 of each kind, all kinds
    python -m tests.fuzz --kind trc --kind c3d --count 500
    python -m tests.fuzz --kind trc --first 1234 --count 1 --keep damaged

Failures are other errors than those of the package, messages of several lines, more than half a minute, more than 6 GB,
and files opened for writing outside of the scratch folder. The number of a case reproduces it. Cases run in separate
processes, so crashes are detected, too.
"""

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from klute_sim.errors import KluteSimError
from tests import fuzz_kinds

TOKENS = (
    *(b"nan", b"inf", b"-inf", b"1e308", b"-1e308", b"1e-320", b"0", b"-0", b"-1", b"99999999999999999999", b"1_0"),
    *(b"", b'"', b"'", b"[", b"]", b"{", b"}", b"=", b",", b";", b"\t", b"\n", b"\r", b"#", b"../../x", b"/etc/passwd"),
    *(b"true", b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", "µ·²".encode(), b"A" * 5000, b"%s%n", b"<script>", b"1979-05-27"),
)
"""Replacements of a word or number."""
LONGEST = 30
"""Time limit of a case [s]."""
MEMORY = 6 * 1024**3
"""Memory limit of a process [bytes]."""
TOGETHER = 250
"""Number of cases per process."""


class TooLongError(Exception):
    """A case exceeded its time limit."""


def _ring(*_: object) -> None:
    raise TooLongError


def damaged(content: bytes, dice: random.Random, text: bool) -> bytes:
    """Return ``content`` with one to three random damages."""
    ways = [_cut, _flip, _copy, _drop, *(5 * [_token, _line] if text else 3 * [_number])]
    for _ in range(dice.choice((1, 1, 1, 2, 3))):
        content = dice.choice(ways)(content, dice)
    return content


def _cut(content: bytes, dice: random.Random) -> bytes:
    return content[: dice.randrange(len(content) + 1)]


def _flip(content: bytes, dice: random.Random) -> bytes:
    found = bytearray(content)
    for _ in range(dice.choice((1, 1, 4, 40)) if found else 0):
        found[dice.randrange(len(found))] = dice.randrange(256)
    return bytes(found)


def _piece(content: bytes, dice: random.Random) -> tuple[int, int]:
    first = dice.randrange(len(content) + 1)
    return first, min(len(content), first + dice.choice((1, 4, 16, 200)))


def _copy(content: bytes, dice: random.Random) -> bytes:
    (first, last), to = _piece(content, dice), dice.randrange(len(content) + 1)
    return content[:to] + content[first:last] * dice.choice((1, 1, 3, 50)) + content[to:]


def _drop(content: bytes, dice: random.Random) -> bytes:
    first, last = _piece(content, dice)
    return content[:first] + content[last:]


def _number(content: bytes, dice: random.Random) -> bytes:
    """Overwrite a random position, preferably in the header, with a typical count of two, four or eight bytes."""
    size = dice.choice((1, 2, 4, 8))
    value = dice.choice((0, 1, 2, 255, 32767, 65535, 2**31 - 1, 2**32 - 1, 2**63 - 1)) % 256**size
    at = dice.randrange(max(1, min(len(content), dice.choice((64, 1024, 4096, len(content) or 1)))))
    return content[:at] + value.to_bytes(size, "little") + content[at + size :]


def _token(content: bytes, dice: random.Random) -> bytes:
    """Replace one word or number, preferably near the header."""
    end = min(len(content), dice.choice((300, 3000, len(content) or 1)))
    first = last = dice.randrange(end + 1)
    apart = b' ,;\t\n="[]{}'
    while first > 0 and content[first - 1] not in apart:
        first -= 1
    while last < len(content) and content[last] not in apart:
        last += 1
    return content[:first] + dice.choice(TOKENS) + content[last:]


def _line(content: bytes, dice: random.Random) -> bytes:
    """Delete, duplicate or exchange lines."""
    lines = content.split(b"\n")
    one, other = dice.randrange(len(lines)), dice.randrange(len(lines))
    match dice.randrange(3):
        case 0:
            del lines[one : one + dice.choice((1, 1, 10, 100))]
        case 1:
            lines.insert(other, lines[one])
        case _:
            lines[one], lines[other] = lines[other], lines[one]
    return b"\n".join(lines)


@contextmanager
def _watched(scratch: Path) -> Iterator[list[str]]:
    """Record files that are opened for writing, created or removed outside of ``scratch``."""
    found: list[str] = []
    inside = (str(scratch.resolve()), os.devnull)
    on = True

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        if not on or event not in ("open", "os.mkdir", "os.remove", "os.rename", "os.rmdir", "os.symlink", "os.link"):
            return
        if event == "open" and not (isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)):
            return
        path = arguments[0]
        if isinstance(path, str | bytes):
            where = os.path.abspath(os.fsdecode(path))
            if not where.startswith(inside) and "__pycache__" not in where:  # Python's own, of a module's first import
                found.append(f"{event} {where}")

    sys.addaudithook(hook)
    try:
        yield found
    finally:
        on = False


def _said(error: KluteSimError) -> str:
    """Return what is wrong with the message of ``error``, or an empty string."""
    text = str(error)
    if not text.strip() or "\n" in text or len(text) > 2000:
        return f"no sentence: {text[:300]!r}"
    return ""


def case(kind: fuzz_kinds.Kind, whole: Sequence[Path], number: int, scratch: Path) -> str:
    """Damage one file as ``number`` determines and read all; return the failure, or an empty string."""
    dice = random.Random(f"{kind.name} {number}")
    given = []
    chosen = dice.randrange(len(whole))
    for place, file in enumerate(whole):
        content = file.read_bytes()
        copy = scratch / file.name
        copy.write_bytes(damaged(content, dice, kind.text) if place == chosen else content)
        given.append(copy)
    signal.alarm(LONGEST)
    try:
        kind.use(given)
    except KluteSimError as error:
        return _said(error)
    except TooLongError:
        return f"more than {LONGEST} s"
    except Exception:
        return traceback.format_exc(limit=-4)
    finally:
        signal.alarm(0)
    return ""


def cases(
    name: str, first: int, count: int, keep: Path | None = None, begun: Callable[[int], object] = lambda number: None
) -> dict[int, str]:
    """Run cases from ``first`` in this process; return the failures by number. ``begun`` receives each number."""
    kind, found = fuzz_kinds.KINDS[name], {}
    signal.signal(signal.SIGALRM, _ring)
    with tempfile.TemporaryDirectory() as folder:
        made, scratch = Path(folder) / "made", Path(folder) / "scratch"
        made.mkdir()
        whole = kind.make(made)
        kind.use(whole)  # is in order, and has compiled what is compiled
        for number in range(first, first + count):
            scratch.mkdir()
            begun(number)
            with _watched(Path(folder)) as written:
                wrong = case(kind, whole, number, scratch)
            if wrong or written:
                found[number] = "\n".join([wrong, *written])
                if keep is not None:
                    scratch.rename(keep / f"{name}_{number}")
                    continue
            for file in sorted(scratch.rglob("*"), reverse=True):
                file.rmdir() if file.is_dir() else file.unlink()
            scratch.rmdir()
    return found


def _bounded() -> None:
    """Limit the memory of this process where the system supports it."""
    try:
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    except (ImportError, ValueError):
        pass


def apart(name: str, first: int, count: int, keep: Path | None = None) -> dict[int, str]:
    """Run the cases in a separate process, which restarts after a crash."""
    found: dict[int, str] = {}
    end = first + count
    while first < end:
        command = [sys.executable, __file__, "--here", "--kind", name]
        command += ["--first", str(first), "--count", str(end - first)]
        command += ["--keep", str(keep)] if keep is not None else []
        done = subprocess.run(
            command,
            env={**os.environ, "PYTHONPATH": str(Path(fuzz_kinds.__file__).parents[1])},
            capture_output=True,
            text=True,
            check=False,
        )
        numbers = [int(line) for line in done.stdout.splitlines() if line.isdigit()]
        for line in done.stdout.splitlines():
            if line.startswith("wrong "):
                _, number, said = line.split(" ", 2)
                found[int(number)] = said.encode().decode("unicode_escape")
        if done.returncode == 0:
            return found
        if not numbers:
            raise RuntimeError(f"undamaged files of kind '{name}' cannot be read: {done.stderr[-2000:]}")
        found[numbers[-1]] = f"ended with {done.returncode}: {done.stderr[-500:]}"
        first = numbers[-1] + 1
    return found


def main(say: Callable[[str], None] = print) -> int:
    """Parse the command line, run, and report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kind", choices=tuple(fuzz_kinds.KINDS), action="append", help="[default: all]")
    parser.add_argument("--count", type=int, default=10_000, help="of each kind  [default: 10000]")
    parser.add_argument("--first", type=int, default=0, help="number of the first one  [default: 0]")
    parser.add_argument("--keep", type=Path, help="folder for the files of cases that went wrong")
    parser.add_argument("--here", action="store_true", help="in this process: to look for what ends it")
    chosen = parser.parse_args()
    if chosen.keep:
        chosen.keep.mkdir(parents=True, exist_ok=True)
    if chosen.here:
        _bounded()
        warnings.simplefilter("ignore")
        asked = chosen.kind[0], chosen.first, chosen.count, chosen.keep
        for number, wrong in cases(*asked, begun=partial(print, flush=True)).items():
            say(f"wrong {number} {wrong.encode('unicode_escape').decode()}")
        return 0
    from rich.console import Console
    from rich.progress import track

    notes, wrong = Console(stderr=True), 0
    for name in chosen.kind or fuzz_kinds.KINDS:
        found: dict[int, str] = {}
        parts = range(chosen.first, chosen.first + chosen.count, TOGETHER)
        for first in track(parts, name, console=notes, disable=not notes.is_terminal):
            found |= apart(name, first, min(TOGETHER, chosen.first + chosen.count - first), chosen.keep)
        for number, what in found.items():
            say(f"{name} {number}: {what}")
        say(f"{name}: {chosen.count} cases, {len(found)} of them wrong")
        wrong += len(found)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
