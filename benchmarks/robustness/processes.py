"""End commands at random moments by a signal, give the same commands again, and count what went wrong.

    python -m benchmarks.robustness.processes --command gait --command sweep --kills 50
    python -m benchmarks.robustness.processes --signal TERM --kills 10

Each kill starts the command in a folder of its own, sends the signal to its first process after a random part of its
usual duration, gives the same command again at once, and looks for processes of the first one ten seconds after the
kill. The columns of the table:

``succeeded``  the second command ended with exit code 0
``complete``   the first command had written all its files, so that the second one refused to overwrite them
``refused``    the second command failed for another reason (0 expected)
``lost``       results that were complete at the kill and are missing or different after the second command (0 expected)
``different``  results that differ from those of an uninterrupted command (0 expected)
``leftovers``  hidden files or folders after the second command (0 expected)
``orphans``    processes of the first command ten seconds after the kill (0 expected; Linux only)
``untidy``     first commands that a signal other than KILL ended with a wrong exit code or a traceback (0 expected)
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import uuid
from dataclasses import dataclass, field, fields
from pathlib import Path

from benchmarks.robustness.commands import COMMANDS, Command

ORPHAN_TIME_S = 10.0
"""Time after a kill within which all processes of the command have to end [s]."""
MARK = "KLUTE_SIM_CAMPAIGN"
"""Environment variable that marks the processes of one command."""


@dataclass
class Count:
    """Sums over the kills of one command; see the module for their meaning."""

    kills: int = 0
    succeeded: int = 0
    complete: int = 0
    refused: int = 0
    lost: int = 0
    different: int = 0
    leftovers: int = 0
    orphans: int = 0
    untidy: int = 0
    remarks: list[str] = field(default_factory=list)

    @property
    def is_clean(self) -> bool:
        """Return whether nothing happened that must not happen."""
        return not any((self.refused, self.lost, self.different, self.leftovers, self.orphans, self.untidy))


def run_campaign(command: Command, kills: int, number: signal.Signals, rng: random.Random, work: Path) -> Count:
    """Send the signal ``number`` to ``kills`` runs of ``command``; ``work`` is an empty folder."""
    inputs = work / "inputs"
    inputs.mkdir()
    command.prepare(inputs)
    expected, duration = _run_undisturbed(command, inputs, work)
    count = Count()
    while count.kills < kills:
        folder = work / "killed"
        shutil.copytree(inputs, folder)
        if not _kill_and_repeat(command, folder, number, rng.uniform(0.0, duration), expected, count):
            duration *= 0.8  # the machine is less busy than in the undisturbed run
        print(f"{command.name}: {count.kills} of {kills}, {len(count.remarks)} remarks", file=sys.stderr, flush=True)
        shutil.rmtree(folder)
    return count


def _run_undisturbed(command: Command, inputs: Path, work: Path) -> tuple[dict[str, bytes], float]:
    """Return the results of ``command`` and its usual duration [s], which compiled code in the cache determines."""
    for attempt in ("first", "second"):
        folder = work / attempt
        shutil.copytree(inputs, folder)
        start = time.monotonic()
        with _start(command, folder, attempt) as process:
            process.wait()
        if process.returncode:
            sys.exit(f"{command.name} fails without any kill: {_read_messages(folder, attempt)}")
    return _read_results(command, folder), time.monotonic() - start


def _kill_and_repeat(
    command: Command, folder: Path, number: signal.Signals, delay: float, expected: dict[str, bytes], count: Count
) -> bool:
    """Send the signal ``number`` after ``delay`` [s], repeat the command, and add what happened to ``count``.

    Returns False when the command ended before the signal; nothing is counted then.
    """
    mark = uuid.uuid4().hex
    with _start(command, folder, mark) as process:
        try:
            process.wait(delay)
            return False
        except subprocess.TimeoutExpired:
            process.send_signal(number)
        process.wait()
        killed, stored, stderr = time.monotonic(), _read_results(command, folder), _read_messages(folder, mark)
        count.kills += 1
        is_tidy = "Traceback" not in stderr and process.returncode in (0, 128 + number, -number)
        if number is not signal.SIGKILL and not is_tidy:
            _report(count, "untidy", f"exit code {process.returncode}: {stderr.strip()}")
    with _start(command, folder, f"{mark}-again") as second:
        second.wait()
    stderr = _read_messages(folder, f"{mark}-again")
    results = _read_results(command, folder)
    if second.returncode == 0:
        count.succeeded += 1
    elif results == expected and "is not empty" in stderr:
        count.complete += 1
    else:
        _report(count, "refused", f"after {delay:.2f} s: {stderr.strip()}")
    lost = [name for name, content in stored.items() if results.get(name) != content]
    different = [name for name, content in expected.items() if name in results and results[name] != content]
    leftovers = [str(path.relative_to(folder)) for path in folder.rglob(".*")]
    for kind, names in (("lost", lost), ("different", different), ("leftovers", leftovers)):
        for name in names:
            _report(count, kind, f"after {delay:.2f} s: {name}")
    time.sleep(max(0.0, killed + ORPHAN_TIME_S - time.monotonic()) if _find_processes(mark) else 0.0)
    for orphan in _find_processes(mark):
        _report(count, "orphans", f"after {delay:.2f} s: process {orphan}")
        os.kill(orphan, signal.SIGKILL)
    return True


def _start(command: Command, folder: Path, mark: str) -> subprocess.Popen[bytes]:
    """Start ``command`` in ``folder``; its messages go to a file, because a pipe would wait for orphans, too.

    All runs of a campaign share one cache, as a user's commands do, so compiled code is there after the first run.
    """
    arguments = [sys.executable, "-m", "klute_sim", *command.arguments]
    environment = {**os.environ, MARK: mark, "KLUTE_SIM_CACHE": str(folder.parent / "cache")}
    with (folder / f"{mark}.txt").open("wb") as messages:
        return subprocess.Popen(
            arguments, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=messages, stdin=subprocess.DEVNULL
        )


def _read_messages(folder: Path, mark: str) -> str:
    return (folder / f"{mark}.txt").read_text("utf-8", errors="replace")


def _read_results(command: Command, folder: Path) -> dict[str, bytes]:
    """Return the content of the result files in ``folder`` by their path; temporary files are no results."""
    files = [file for pattern in command.results for file in folder.glob(pattern)]
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in files
        if not any(part.startswith(".") for part in file.relative_to(folder).parts)
    }


def _find_processes(mark: str) -> list[int]:
    """Return the numbers of the processes with ``mark``; none on systems without /proc."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if f"{MARK}={mark}\0".encode() in (folder / "environ").read_bytes():
                found.append(int(folder.name))
        except OSError:  # it has ended, or belongs to somebody else
            continue
    return found


def _report(count: Count, kind: str, remark: str) -> None:
    setattr(count, kind, getattr(count, kind) + 1)
    count.remarks.append(f"{kind}: {remark}")


def main() -> None:
    """Run the campaigns of the command line; the exit code is 1 if something went wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--command", action="append", choices=sorted(COMMANDS), help="may be repeated; default: all")
    parser.add_argument("--kills", type=int, default=50, help="number of kills per command")
    parser.add_argument("--signal", default="KILL", choices=["KILL", "TERM", "HUP", "INT"])
    parser.add_argument("--seed", type=int, default=0, help="seed of the random moments")
    options = parser.parse_args()
    columns = [column.name for column in fields(Count) if column.name != "remarks"]
    print("".join(f"{name:>11}" for name in ("command", *columns)))
    is_clean = True
    for name in options.command or COMMANDS:
        with tempfile.TemporaryDirectory() as work:
            count = run_campaign(
                COMMANDS[name],
                options.kills,
                signal.Signals[f"SIG{options.signal}"],
                random.Random(options.seed),
                Path(work),
            )
        print("".join(f"{value:>11}" for value in (name, *(getattr(count, column) for column in columns))), flush=True)
        for remark in count.remarks:
            print(f"    {remark}", flush=True)
        is_clean &= count.is_clean
    sys.exit(0 if is_clean else 1)


if __name__ == "__main__":
    main()
