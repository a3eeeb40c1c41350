"""Diagnose datasets with hidden effects and compare the verdicts with the ground truth.

    python -m benchmarks.hidden_effects.run OUT --split test                     # all blocks
    python -m benchmarks.hidden_effects.run OUT --block single --count 31        # a part

Missing datasets are generated, every result is saved immediately, and results of the current code are reused, so the
run can be interrupted and restarted. A program that ends without a verdict has the outcome ``failed``, which is not
saved: the next run tries again. Blocks advance together, each in a random order, so an interrupted run is a sample
of all of them, which ``--finished`` scores. ``--shard 2/4`` processes the second quarter of every block, for several
machines that share OUT. Thresholds are set on the development split; the test split is for published numbers. The
ground truth is read only after the verdict is saved. The direct measurements that an `indistinguishable` verdict lists
are made as a follow-up, which takes a laboratory minutes; without any, the decisive experiment that it proposes is
performed. ``--finished`` scores stored results of any code and diagnoses nothing; OUT can hold unpacked archives of
``results/``, whose seeds are then named together (``--seed 5656 9797``).
``--baselines`` adds other methods (:mod:`baselines`), which require ``pip install --group benchmark`` and test benches.
"""

import argparse
import hashlib
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.hidden_effects import follow_up, joint_follow_up, joints, walks
from benchmarks.hidden_effects.adversary.dataset import make_dataset as make_adversary_dataset
from benchmarks.hidden_effects.catalogue import EXACT_TWINS
from benchmarks.hidden_effects.direct_measurement import list_refuted_names
from benchmarks.hidden_effects.generate import make_dataset
from benchmarks.hidden_effects.metrics import MIN_DECISIVE_CHI2, DatasetResult
from benchmarks.hidden_effects.page import render_page
from benchmarks.hidden_effects.plan import (
    ADVERSARY_BLOCK,
    BLOCK_SIZES,
    GAIT_BLOCKS,
    JOINT_BLOCKS,
    SPLIT_SEEDS,
    DatasetSpec,
    sample_datasets,
)
from benchmarks.hidden_effects.report import print_report
from benchmarks.hidden_effects.score import FAILED_VERDICT, score_follow_up, score_verdict
from rich.console import Console
from rich.progress import track

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
CODE_SUFFIXES = {".py", ".toml", ".json"}
"""Suffixes of the files that determine a verdict: code, protocols and presets, calibrations."""
DIGEST_LENGTH = 12
"""Hexadecimal digits of the digest of the code in the name of a result."""
Verdict = dict[str, Any]
MAKERS: Mapping[str, Callable[..., Verdict]] = {
    "bench": make_dataset,
    "gait": walks.make_dataset,
    "joint": joints.make_dataset,
}
"""Rig -> function that makes a dataset."""
FOLLOW_UP_MAKERS: Mapping[str, Callable[..., None]] = {
    "bench": follow_up.make_follow_up,
    "joint": joint_follow_up.make_follow_up,
}
"""Rig -> function that performs the proposed experiment; those of walks are not performed."""


def compute_code_digest(rig: str = "bench") -> str:
    """Return the digest of all code that determines a verdict on ``rig`` (``bench``, ``gait`` or ``joint``)."""
    package = ROOT / "src" / "klute_sim"
    parts = ("files", "laws", "effects", "device", "datasets", "bench", "plant", "plausibility", "diagnosis")
    parts += {"bench": (), "gait": ("gait",), "joint": ("mechanism",)}[rig]
    files = [file for part in parts for file in (package / part).rglob("*") if file.suffix in CODE_SUFFIXES]
    files += [package / module for module in ("constants.py", "parameters.py", "types.py", "units.py")]
    files = sorted(files)
    if rig == "joint":
        files.append(ROOT / "models" / "antagonist_joint.xml")
    if rig == "gait":
        files.append(ROOT / "models" / "ankle.xml")
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:DIGEST_LENGTH]


def compute_baselines_digest() -> str:
    """Return the digest of all code that determines the answers of the baseline methods."""
    files = sorted((HERE / "baselines").glob("*.py"))
    return hashlib.sha256(
        b"".join([compute_code_digest().encode(), *(file.read_bytes() for file in files)])
    ).hexdigest()[:DIGEST_LENGTH]


def run_diagnosis(dataset: Path, exclude: tuple[str, ...], n_jobs: int) -> Verdict:
    """Run ``klute-sim diagnose`` on ``dataset`` as a user would."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "klute_sim", "diagnose", str(dataset), "--json", "--no-report"]
        command += ["--jobs", str(n_jobs), "--out", str(Path(folder) / "found")]
        return _run_for_verdict(command, exclude)


def run_baseline(method: str, dataset: Path, exclude: tuple[str, ...]) -> Verdict:
    """Run the baseline method ``method`` on ``dataset``, in a process of its own to measure its processor time."""
    return _run_for_verdict(
        [sys.executable, "-m", "benchmarks.hidden_effects.baselines", method, str(dataset)], exclude
    )


def _run_for_verdict(command: Sequence[str], exclude: tuple[str, ...]) -> Verdict:
    """Return the verdict that ``command`` prints; one that says so where it crashes."""
    options = [option for name in exclude for option in ("--exclude", name)]
    completed, seconds, processor_seconds = run_measured([*command, *options])
    times = {"s": seconds, "cpu_s": processor_seconds}
    if completed.returncode != 0:  # 2: unreadable data is refused with one sentence
        answer = {"reasons": [completed.stderr], "effects": [], "alternatives": []}
        return {"verdict": "insufficient-data" if completed.returncode == 2 else FAILED_VERDICT, **answer, **times}
    verdict: Verdict = json.loads(completed.stdout)
    return verdict | times


def run_measured(command: Sequence[str]) -> tuple[subprocess.CompletedProcess[str], float, float]:
    """Run ``command`` (POSIX); return it with its output, and the elapsed and processor time [s], children included."""
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8") as stdout,
        tempfile.TemporaryFile("w+", encoding="utf-8") as stderr,
    ):
        start = time.perf_counter()
        process = subprocess.Popen(command, stdout=stdout, stderr=stderr)
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - start
        process.returncode = os.waitstatus_to_exitcode(status)
        stdout.seek(0)
        stderr.seek(0)
        completed = subprocess.CompletedProcess(command, process.returncode, stdout.read(), stderr.read())
    return completed, seconds, usage.ru_utime + usage.ru_stime


def load_or_compute(path: Path, compute: Callable[[], Verdict]) -> Verdict:
    """Return the content of ``path``; if it is missing, store the result of ``compute`` first, unless it failed."""
    if not path.exists():
        computed = compute()
        if computed["verdict"] == FAILED_VERDICT:
            return computed
        temporary = path.with_suffix(".unfinished")
        temporary.write_text(json.dumps(computed, indent=1), "utf-8")
        temporary.rename(path)
    stored: Verdict = json.loads(path.read_text("utf-8"))
    return stored


class BenchmarkRun:
    """One folder of datasets and results for the current code."""

    def __init__(self, folder: Path, n_jobs: int, methods: dict[str, Callable[..., Verdict]]) -> None:
        """Set up the folder; ``methods`` are the baseline methods by name."""
        self._folder, self._n_jobs, self._methods = folder, n_jobs, methods
        self._code_digests, self._baselines_digest = (
            {rig: compute_code_digest(rig) for rig in MAKERS},
            compute_baselines_digest(),
        )
        (folder / "results").mkdir(parents=True, exist_ok=True)

    def process_dataset(self, spec: DatasetSpec) -> tuple[DatasetResult, dict[str, DatasetResult]]:
        """Return the results of the dataset ``spec`` for the program and for every baseline method."""
        name, rig = spec["name"], get_rig(spec["block"])
        dataset, truth_file = self._folder / name, self._folder / f"{name}.truth.json"
        if not truth_file.exists():
            arguments = {key: value for key, value in spec.items() if key != "name"}
            get_maker(spec["block"])(dataset, **arguments, truth=truth_file)
        excluded = list_excluded(spec["effects"]) if spec.get("deleted") else ()
        verdict = load_or_compute(
            self._result_path(name, self._code_digests[rig]),
            partial(run_diagnosis, dataset, excluded, self._n_jobs),
        )
        answers = {
            method: load_or_compute(
                self._result_path(f"{name}_{method}", self._baselines_digest), partial(answer, dataset, excluded)
            )
            for method, answer in self._methods.items()
        }
        truth = json.loads(truth_file.read_text("utf-8"))
        second_outcome, measure_again = None, self._find_follow_up(spec, rig, dataset, truth, verdict, excluded)
        if measure_again is not None:
            second_verdict = load_or_compute(
                self._result_path(f"{name}_second", self._code_digests[rig]), measure_again
            )
            second_outcome = score_follow_up(truth, second_verdict)
        own_result = DatasetResult(name, truth, verdict, score_verdict(truth, verdict), second_outcome)
        return own_result, {
            method: DatasetResult(name, truth, other, score_verdict(truth, other)) for method, other in answers.items()
        }

    def load_finished(self, spec: DatasetSpec) -> DatasetResult | None:
        """Return the stored result of the dataset ``spec``, of whatever code; None if there is none.

        Raises ValueError if results of several codes are stored.
        """
        name = spec["name"]
        verdict_file, second_file = self._find_result(name), self._find_result(f"{name}_second")
        if verdict_file is None:
            return None
        truth, verdict = (
            json.loads(file.read_text("utf-8")) for file in (self._folder / f"{name}.truth.json", verdict_file)
        )
        second_outcome = second_file and score_follow_up(truth, json.loads(second_file.read_text("utf-8")))
        return DatasetResult(name, truth, verdict, score_verdict(truth, verdict), second_outcome)

    def has_truth(self, spec: DatasetSpec) -> bool:
        """Return whether the dataset ``spec`` was begun."""
        return (self._folder / f"{spec['name']}.truth.json").exists()

    def _find_result(self, name: str) -> Path | None:
        files = list((self._folder / "results").glob(f"{name}_{'[0-9a-f]' * DIGEST_LENGTH}.json"))
        if len(files) > 1:
            raise ValueError(f"{self._folder}: results of {len(files)} codes for {name}; keep those of one")
        return files[0] if files else None

    def _result_path(self, name: str, digest: str) -> Path:
        return self._folder / "results" / f"{name}_{digest}.json"

    def _find_follow_up(
        self,
        spec: DatasetSpec,
        rig: str,
        dataset: Path,
        truth: dict[str, Any],
        verdict: Verdict,
        excluded: tuple[str, ...],
    ) -> Callable[[], Verdict] | None:
        """Return what makes and diagnoses the decisive measurement that ``verdict`` proposes; None without any."""
        if verdict["verdict"] != "indistinguishable" or spec["block"] == ADVERSARY_BLOCK:  # of other laws
            return None
        refuted = list_refuted_names(truth, verdict)
        if refuted:
            return partial(run_diagnosis, dataset, (*excluded, *refuted), self._n_jobs)
        can_run_protocols = rig in FOLLOW_UP_MAKERS
        proposal = verdict["next_experiment"]
        is_proposed = proposal is not None and proposal["protocol"] is not None
        if can_run_protocols and is_proposed and proposal["separation_chi2"] >= MIN_DECISIVE_CHI2:
            return partial(self._run_follow_up, FOLLOW_UP_MAKERS[rig], dataset, truth, verdict, excluded)
        return None

    def _run_follow_up(
        self,
        make_follow_up: Callable[..., None],
        dataset: Path,
        truth: dict[str, Any],
        verdict: Verdict,
        excluded: tuple[str, ...],
    ) -> Verdict:
        with tempfile.TemporaryDirectory() as folder:
            make_follow_up(dataset, truth, verdict["next_experiment"], Path(folder) / "again")
            return run_diagnosis(Path(folder) / "again", excluded, self._n_jobs)


def get_rig(block: str) -> str:
    """Return the rig of ``block``."""
    return "gait" if block in GAIT_BLOCKS else "joint" if block in JOINT_BLOCKS else "bench"


def get_maker(block: str) -> Callable[..., Verdict]:
    """Return the function that makes a dataset of ``block``."""
    return make_adversary_dataset if block == ADVERSARY_BLOCK else MAKERS[get_rig(block)]


def list_excluded(effects: Sequence[Mapping[str, Any]]) -> tuple[str, ...]:
    """Return the names that the diagnosis must not know: those of ``effects`` and of their exact twins."""
    names = [effect["name"] for effect in effects]
    return (*names, *(twin for name in names for twin in EXACT_TWINS.get(name, ())))


def load_baselines() -> dict[str, Callable[..., Verdict]]:
    """Return the baseline methods by name; raises ModuleNotFoundError with installation advice if one cannot run."""
    from benchmarks.hidden_effects import baselines

    baselines.require_packages()
    return {name: partial(run_baseline, name) for name in baselines.METHODS}


def get_page_order(row: DatasetResult) -> tuple[int, str]:
    """Return the place of ``row`` on the page: blocks as in the plan, datasets by name."""
    return list(BLOCK_SIZES).index(row.truth["block"]), row.name


def plan_run(blocks: Sequence[str], count: int | None, seed: int, shard: str = "1/1") -> list[DatasetSpec]:
    """Return the datasets of ``shard`` of all ``blocks``, such that at any point the same share of each block is done.

    Each block is in a random order, so that this share is a sample of it. ``count`` is the number of datasets of every
    block; None stands for :data:`BLOCK_SIZES`.
    """
    part, parts = parse_shard(shard)
    planned = []
    for block in blocks:
        size = BLOCK_SIZES[block] if count is None else count
        planned += [((i + 0.5) / size, spec) for i, spec in enumerate(sample_datasets(block, count, seed))][
            part - 1 :: parts
        ]
    return [spec for _, spec in sorted(planned, key=lambda entry: entry[0])]


def parse_shard(text: str) -> tuple[int, int]:
    """Return part and number of parts of ``I/N``; raises ValueError unless I is 1 to N."""
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    part, parts = (int(match[1]), int(match[2])) if match else (0, 0)
    if not 1 <= part <= parts:
        raise ValueError(f"shard {text!r} is no part I/N with I from 1 to N, such as 2/4")
    return part, parts


def main() -> None:
    """Generate, diagnose, score and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of datasets and results")
    parser.add_argument("--block", choices=tuple(BLOCK_SIZES), action="append", help="may be repeated  [default: all]")
    parser.add_argument("--count", type=int, help="datasets of every block  [default: as many as tell enough]")
    parser.add_argument("--split", choices=tuple(SPLIT_SEEDS), default="development", help="[default: development]")
    parser.add_argument("--seed", type=int, nargs="+", metavar="N", help="seeds of your own in place of the split's")
    parser.add_argument("--shard", default="1/1", metavar="I/N", help="do the I-th of N parts  [default: 1/1]")
    parser.add_argument("--at-once", type=int, default=1, metavar="N", help="datasets at once  [default: 1]")
    parser.add_argument("--baselines", action="store_true", help="run the other methods, too")
    parser.add_argument("--finished", action="store_true", help="score stored results only, of any code")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the page of results")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    try:
        methods = load_baselines() if arguments.baselines else {}
    except ModuleNotFoundError as error:
        parser.error(str(error))
    blocks = [block for block in arguments.block or BLOCK_SIZES if not (methods and get_rig(block) != "bench")]
    seeds = arguments.seed or [SPLIT_SEEDS[arguments.split]]
    try:
        specs = [spec for seed in seeds for spec in plan_run(blocks, arguments.count, seed, arguments.shard)]
    except ValueError as error:
        parser.error(str(error))
    console = Console(stderr=True)
    run = BenchmarkRun(arguments.out, max(1, (os.cpu_count() or 1) // arguments.at_once), methods)
    if arguments.finished:
        found = [(spec, run.load_finished(spec)) for spec in specs]
        rows = sorted((row for _, row in found if row is not None), key=get_page_order)
        unfinished = [spec["name"] for spec, row in found if row is None and run.has_truth(spec)]
        if unfinished:
            console.print(
                f"Not scored: {', '.join(unfinished)}. These datasets were begun and have no result: the run was "
                "interrupted, or the program failed. The page does not count them.",
                style="yellow",
                highlight=False,
            )
        others = {}
    else:
        with ThreadPoolExecutor(arguments.at_once) as pool:
            results = track(
                pool.map(run.process_dataset, specs),
                "diagnosing",
                len(specs),
                console=console,
                disable=not console.is_terminal,
            )
            completed = sorted(results, key=lambda result: get_page_order(result[0]))
        rows = [row for row, _ in completed]
        others = {method: [method_results[method] for _, method_results in completed] for method in methods}
    if not rows:
        parser.error(
            f"{arguments.out / 'results'} has no result of seed {', '.join(map(str, seeds))} in these blocks; see "
            "--seed and --split"
        )
    if arguments.page:
        head = {
            "split": ", ".join(f"seed {seed}" for seed in arguments.seed) if arguments.seed else arguments.split,
            "datasets": f"{len(rows)} of {len(specs)} planned",
        }
        if arguments.finished:
            head["begun without a result"] = ", ".join(unfinished) or "none"
        else:  # stored results may be of other code, on another machine
            head |= {"code": compute_code_digest(), "at once": arguments.at_once}
        arguments.page.write_text(render_page(rows, others, head), "utf-8")
    print_report(rows, others, as_json=arguments.json)


if __name__ == "__main__":
    main()
