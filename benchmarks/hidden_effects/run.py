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

from benchmarks.hidden_effects import walks
from benchmarks.hidden_effects.generate import make_dataset
from benchmarks.hidden_effects.metrics import DatasetResult
from benchmarks.hidden_effects.page import render_page
from benchmarks.hidden_effects.plan import BLOCK_SIZES, GAIT_BLOCKS, HALF_SEEDS, DatasetSpec, plan_datasets
from benchmarks.hidden_effects.report import print_report
from benchmarks.hidden_effects.score import score_follow_up, score_verdict
from benchmarks.hidden_effects.second_round import make_follow_up
from rich.console import Console
from rich.progress import track

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
Verdict = dict[str, Any]


def compute_code_digest(*, include_gait: bool = False) -> str:
    """Digest of everything that decides a verdict; of ``walks``, the replay too."""
    parts = ("laws", "effects", "device", "dataset", "diagnose", *(("rigs/replay",) if include_gait else ()))
    files = sorted(file for part in parts for file in (ROOT / "src" / "klute_sim" / part).rglob("*.py"))
    if include_gait:
        rig = ROOT / "src" / "klute_sim" / "rigs" / "gait"
        files += [rig / "build.py", rig / "body.py", ROOT / "models" / "ankle.xml"]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def compute_baselines_digest() -> str:
    """Digest of everything that decides what the other methods say."""
    files = (HERE / "baselines.py", HERE / "force_balance.py")
    return hashlib.sha256(
        b"".join([compute_code_digest().encode(), *(file.read_bytes() for file in files)])
    ).hexdigest()[:12]


def run_diagnosis(dataset: Path, exclude: tuple[str, ...], n_jobs: int) -> Verdict:
    """Run ``klute-sim diagnose`` on ``dataset`` as a user would."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "klute_sim", "diagnose", str(dataset), "--json", "--no-report"]
        command += ["--jobs", str(n_jobs), "--out", str(Path(folder) / "found")]
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


def load_or_compute(path: Path, compute: Callable[[], Verdict]) -> Verdict:
    """What ``file`` holds; what ``answer`` says is put there first if it is not there."""
    if not path.exists():
        fresh = path.with_suffix(".unfinished")
        fresh.write_text(json.dumps(compute(), indent=1), "utf-8")
        fresh.rename(path)
    found: Verdict = json.loads(path.read_text("utf-8"))
    return found


class BenchmarkRun:
    """One folder of datasets and results, with the code as it is."""

    def __init__(self, folder: Path, n_jobs: int, methods: dict[str, Callable[..., Verdict]]) -> None:
        """``methods`` are others that are done beside it, by their names."""
        self._folder, self._n_jobs, self._methods = folder, n_jobs, methods
        self._code_digests, self._baselines_digest = (
            {False: compute_code_digest(), True: compute_code_digest(include_gait=True)},
            compute_baselines_digest(),
        )
        (folder / "results").mkdir(parents=True, exist_ok=True)

    def process_dataset(self, spec: DatasetSpec) -> tuple[DatasetResult, dict[str, DatasetResult]]:
        """What was found in the dataset of ``spec``, by the program and by every other method."""
        name, of_walks = spec["name"], spec["block"] in GAIT_BLOCKS
        dataset, truth_file = self._folder / name, self._folder / f"{name}.truth.json"
        if not truth_file.exists():
            what = {key: value for key, value in spec.items() if key != "name"}
            (walks.make_dataset if of_walks else make_dataset)(dataset, **what, truth=truth_file)
        deleted = tuple(e["name"] for e in spec["effects"]) if spec.get("deleted") else ()
        verdict = load_or_compute(
            self._result_path(name, self._code_digests[of_walks]),
            partial(run_diagnosis, dataset, deleted, self._n_jobs),
        )
        found = {
            method: load_or_compute(
                self._result_path(f"{name}_{method}", self._baselines_digest), partial(answer, dataset, deleted)
            )
            for method, answer in self._methods.items()
        }
        truth = json.loads(truth_file.read_text("utf-8"))
        second = None
        if verdict["verdict"] == "ambiguous" and verdict["next_experiment"]:
            again = load_or_compute(
                self._result_path(f"{name}_second", self._code_digests[of_walks]),
                partial(self._run_follow_up, dataset, truth, verdict, deleted),
            )
            second = score_follow_up(truth, again)
        own = DatasetResult(name, truth, verdict, score_verdict(truth, verdict), second)
        # Whether anything is left to name is the dataset's own: all are held against the same refitted device.
        same = {"gap": verdict.get("gap", {}), "alike": verdict.get("alike", ())}
        return own, {
            method: DatasetResult(name, truth, other, score_verdict(truth, {**other, **same}))
            for method, other in found.items()
        }

    def _result_path(self, name: str, digest: str) -> Path:
        return self._folder / "results" / f"{name}_{digest}.json"

    def _run_follow_up(
        self, dataset: Path, truth: dict[str, Any], verdict: Verdict, excluded: tuple[str, ...]
    ) -> Verdict:
        with tempfile.TemporaryDirectory() as folder:
            make_follow_up(dataset, truth, verdict["next_experiment"], Path(folder) / "again")
            return run_diagnosis(Path(folder) / "again", excluded, self._n_jobs)


def load_baselines() -> dict[str, Callable[..., Verdict]]:
    """Name -> method; raises ModuleNotFoundError, with what to install, if one cannot run."""
    from benchmarks.hidden_effects import baselines

    baselines.require_pysindy()
    return {"plain_bic": baselines.select_by_bic, "sindy": baselines.regress_sparsely}


def _iter_specs(blocks: list[str], count: int | None, seed: int, shard: str) -> Iterator[DatasetSpec]:
    part, parts = (int(x) for x in shard.split("/"))
    for block in blocks:
        yield from plan_datasets(block, BLOCK_SIZES[block] if count is None else count, seed)[part - 1 :: parts]


def main() -> None:
    """Make, diagnose, score, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of datasets and results")
    parser.add_argument("--block", choices=tuple(BLOCK_SIZES), action="append", help="may be repeated  [default: all]")
    parser.add_argument("--count", type=int, help="datasets of every block  [default: as many as tell enough]")
    parser.add_argument("--half", choices=tuple(HALF_SEEDS), default="development", help="[default: development]")
    parser.add_argument("--shard", default="1/1", metavar="I/N", help="do the I-th of N parts  [default: 1/1]")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="datasets at once  [default: 1]")
    parser.add_argument("--baselines", action="store_true", help="do other methods, too")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the page of results")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    chosen = parser.parse_args()
    try:
        methods = load_baselines() if chosen.baselines else {}
    except ModuleNotFoundError as error:
        parser.error(str(error))
    blocks = [block for block in chosen.block or BLOCK_SIZES if not (methods and block in GAIT_BLOCKS)]
    specs = list(_iter_specs(blocks, chosen.count, HALF_SEEDS[chosen.half], chosen.shard))
    notes = Console(stderr=True)
    run = BenchmarkRun(chosen.out, max(1, (os.cpu_count() or 1) // chosen.at_once), methods)
    with ThreadPoolExecutor(chosen.at_once) as pool:
        going = track(
            pool.map(run.process_dataset, specs), "diagnosing", len(specs), console=notes, disable=not notes.is_terminal
        )
        done = list(going)
    rows = [row for row, _ in done]
    others = {method: [each[method] for _, each in done] for method in methods}
    if chosen.page:
        head = {"half": chosen.half, "code": compute_code_digest(), "datasets": len(rows), "at once": chosen.at_once}
        chosen.page.write_text(render_page(rows, others, head), "utf-8")
    print_report(rows, others, as_json=chosen.json)


if __name__ == "__main__":
    main()
