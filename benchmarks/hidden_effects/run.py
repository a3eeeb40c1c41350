"""Diagnose datasets with hidden effects and hold the verdicts against the truth.

    python benchmarks/hidden_effects/run.py OUT --half test                      # everything: all blocks
    python benchmarks/hidden_effects/run.py OUT --block single --count 31        # a part of it

Datasets are made where they are missing, every result is saved as soon as it is there, and what has been done with
this code is not done again: interrupt it and start it again as you like. ``--shard 2/4`` does the second quarter of
every block, for several machines that share OUT. Thresholds are set on the development half; the test half is for
numbers to be told. The truth is opened only after the verdict is on the disk. What an ambiguous verdict asks for is
measured in a second round. ``--baselines`` puts two other methods beside it (:mod:`baselines`), kept alike; they need
``pip install --group benchmark``, and know nothing of walks, which are left out then.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import walks
from generate import make
from metrics import Row
from page import page
from plan import BLOCKS, HALVES, WALKS, Spec, plan
from rich.console import Console
from rich.progress import track
from score import resolved, score
from second_round import second_round

from report import report

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
Verdict = dict[str, Any]


def code(*, walks: bool = False) -> str:
    """Digest of everything that decides a verdict; of ``walks``, the replay too."""
    parts = ("laws", "effects", "device", "dataset", "diagnose", *(("rigs/replay",) if walks else ()))
    files = sorted(file for part in parts for file in (ROOT / "src" / "klute_sim" / part).rglob("*.py"))
    if walks:
        rig = ROOT / "src" / "klute_sim" / "rigs" / "gait"
        files += [rig / "build.py", rig / "body.py", ROOT / "models" / "ankle.xml"]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def code_of_baselines() -> str:
    """Digest of everything that decides what the other methods say."""
    files = (HERE / "baselines.py", HERE / "force_balance.py")
    return hashlib.sha256(b"".join([code().encode(), *(file.read_bytes() for file in files)])).hexdigest()[:12]


def verdict_of(dataset: Path, exclude: tuple[str, ...], threads: int) -> Verdict:
    """Run ``klute-sim diagnose`` on ``dataset`` as a user would."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "klute_sim", "diagnose", str(dataset), "--json", "--no-report"]
        command += ["--jobs", str(threads), "--out", str(Path(folder) / "found")]
        for name in exclude:
            command += ["--exclude", name]
        begin = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        seconds = time.perf_counter() - begin
    if done.returncode == 2:  # data that cannot be read is refused in a sentence
        said = {"reasons": [done.stderr], "effects": [], "alternatives": []}
        return {"verdict": "insufficient-data", **said, "s": seconds}
    if done.returncode != 0:
        raise RuntimeError(f"{dataset}: {done.stderr}")
    found: Verdict = json.loads(done.stdout)
    return found | {"s": seconds}


def kept(file: Path, answer: Callable[[], Verdict]) -> Verdict:
    """What ``file`` holds; what ``answer`` says is put there first if it is not there."""
    if not file.exists():
        fresh = file.with_suffix(".unfinished")
        fresh.write_text(json.dumps(answer(), indent=1), "utf-8")
        fresh.rename(file)
    found: Verdict = json.loads(file.read_text("utf-8"))
    return found


class Run:
    """One folder of datasets and results, with the code as it is."""

    def __init__(self, out: Path, threads: int, methods: dict[str, Callable[..., Verdict]]) -> None:
        """``methods`` are others that are done beside it, by their names."""
        self._out, self._threads, self._methods = out, threads, methods
        self._own, self._beside = {False: code(), True: code(walks=True)}, code_of_baselines()
        (out / "results").mkdir(parents=True, exist_ok=True)

    def done(self, spec: Spec) -> tuple[Row, dict[str, Row]]:
        """What was found in the dataset of ``spec``, by the program and by every other method."""
        name, of_walks = spec["name"], spec["block"] in WALKS
        dataset, truth_file = self._out / name, self._out / f"{name}.truth.json"
        if not truth_file.exists():
            what = {key: value for key, value in spec.items() if key != "name"}
            (walks.make if of_walks else make)(dataset, **what, truth=truth_file)
        deleted = tuple(e["name"] for e in spec["effects"]) if spec.get("deleted") else ()
        verdict = kept(self._file(name, self._own[of_walks]), partial(verdict_of, dataset, deleted, self._threads))
        found = {
            method: kept(self._file(f"{name}_{method}", self._beside), partial(answer, dataset, deleted))
            for method, answer in self._methods.items()
        }
        truth = json.loads(truth_file.read_text("utf-8"))
        second = None
        if verdict["verdict"] == "ambiguous" and verdict["next_experiment"]:
            again = kept(
                self._file(f"{name}_second", self._own[of_walks]),
                partial(self._second, dataset, truth, verdict, deleted),
            )
            second = resolved(truth, again)
        own = Row(name, truth, verdict, score(truth, verdict), second)
        # Whether anything is left to name is the dataset's own: all are held against the same refitted device.
        same = {"gap": verdict.get("gap", {}), "alike": verdict.get("alike", ())}
        return own, {
            method: Row(name, truth, other, score(truth, {**other, **same})) for method, other in found.items()
        }

    def _file(self, name: str, digest: str) -> Path:
        return self._out / "results" / f"{name}_{digest}.json"

    def _second(self, dataset: Path, truth: dict[str, Any], verdict: Verdict, deleted: tuple[str, ...]) -> Verdict:
        with tempfile.TemporaryDirectory() as folder:
            second_round(dataset, truth, verdict["next_experiment"], Path(folder) / "again")
            return verdict_of(Path(folder) / "again", deleted, self._threads)


def other_methods() -> dict[str, Callable[..., Verdict]]:
    """Name -> method; raises ModuleNotFoundError, with what to install, if one cannot run."""
    import baselines  # the project's own benchmark does without what these need

    baselines.need_pysindy()
    return {"plain_bic": baselines.plain_bic, "sindy": baselines.sindy}


def _specs(blocks: list[str], count: int | None, seed: int, shard: str) -> Iterator[Spec]:
    part, parts = (int(x) for x in shard.split("/"))
    for block in blocks:
        yield from plan(block, BLOCKS[block] if count is None else count, seed)[part - 1 :: parts]


def main() -> None:
    """Make, diagnose, score, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of datasets and results")
    parser.add_argument("--block", choices=tuple(BLOCKS), action="append", help="may be repeated  [default: all]")
    parser.add_argument("--count", type=int, help="datasets of every block  [default: as many as tell enough]")
    parser.add_argument("--half", choices=tuple(HALVES), default="development", help="[default: development]")
    parser.add_argument("--shard", default="1/1", metavar="I/N", help="do the I-th of N parts  [default: 1/1]")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="datasets at once  [default: 1]")
    parser.add_argument("--baselines", action="store_true", help="do other methods, too")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the page of results")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    chosen = parser.parse_args()
    try:
        methods = other_methods() if chosen.baselines else {}
    except ModuleNotFoundError as error:
        parser.error(str(error))
    blocks = [block for block in chosen.block or BLOCKS if not (methods and block in WALKS)]
    specs = list(_specs(blocks, chosen.count, HALVES[chosen.half], chosen.shard))
    notes = Console(stderr=True)
    run = Run(chosen.out, max(1, (os.cpu_count() or 1) // chosen.at_once), methods)
    with ThreadPoolExecutor(chosen.at_once) as pool:
        going = track(pool.map(run.done, specs), "diagnosing", len(specs), console=notes, disable=not notes.is_terminal)
        done = list(going)
    rows = [row for row, _ in done]
    others = {method: [each[method] for _, each in done] for method in methods}
    if chosen.page:
        head = {"half": chosen.half, "code": code(), "datasets": len(rows), "at once": chosen.at_once}
        chosen.page.write_text(page(rows, others, head), "utf-8")
    report(rows, others, as_json=chosen.json)


if __name__ == "__main__":
    main()
