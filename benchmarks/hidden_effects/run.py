"""Diagnose datasets with hidden effects and hold the verdicts against the truth.

    python benchmarks/hidden_effects/run.py OUT --block single --count 20 --seed 1

Datasets are made where they are missing, every result is saved as soon as it is there, and what has been done with
this code is not done again: interrupt it and start it again as you like. ``--shard 2/4`` does the second quarter, for
several machines that share OUT. Block ``deleted`` takes block ``single`` with the true effect struck from the
catalogue. The truth is opened only after the verdict is on the disk. ``--baselines`` puts two other methods beside it
(:mod:`baselines`), kept alike; they need ``pip install --group benchmark``.
"""

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from generate import make
from plan import BLOCKS, plan
from rich.console import Console
from rich.progress import track
from score import score

from report import Row, report

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
Verdict = dict[str, Any]


def code() -> str:
    """Digest of everything that decides a verdict."""
    parts = ("laws", "effects", "device", "dataset", "diagnose")
    files = sorted(file for part in parts for file in (ROOT / "src" / "klute_sim" / part).rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def code_of_baselines() -> str:
    """Digest of everything that decides what the other methods say."""
    files = (HERE / "baselines.py", HERE / "force_balance.py")
    return hashlib.sha256(b"".join([code().encode(), *(file.read_bytes() for file in files)])).hexdigest()[:12]


def verdict_of(dataset: Path, exclude: tuple[str, ...]) -> Verdict:
    """Run ``klute-sim diagnose`` on ``dataset`` as a user would."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "klute_sim", "diagnose", str(dataset), "--json", "--no-report"]
        command += ["--out", str(Path(folder) / "found")]
        for name in exclude:
            command += ["--exclude", name]
        begin = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        seconds = time.perf_counter() - begin
    if done.returncode == 2:  # data that cannot be read is refused in a sentence
        return {"verdict": "insufficient-data", "effects": [], "alternatives": [], "said": done.stderr, "s": seconds}
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


def other_methods() -> dict[str, Callable[..., Verdict]]:
    """Name -> method; raises ModuleNotFoundError, with what to install, if one cannot run."""
    import baselines  # the project's own benchmark does without what these need

    baselines.need_pysindy()
    return {"plain_bic": baselines.plain_bic, "sindy": baselines.sindy}


def main() -> None:
    """Make, diagnose, score, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of datasets and results")
    parser.add_argument("--block", choices=(*BLOCKS, "deleted"), required=True)
    parser.add_argument("--count", type=int, default=20, help="datasets of the block  [default: 20]")
    parser.add_argument("--seed", type=int, default=1, help="of the block  [default: 1]")
    parser.add_argument("--shard", default="1/1", metavar="I/N", help="do the I-th of N parts  [default: 1/1]")
    parser.add_argument("--baselines", action="store_true", help="do other methods, too")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    chosen = parser.parse_args()
    part, parts = (int(x) for x in chosen.shard.split("/"))
    block = "single" if chosen.block == "deleted" else chosen.block
    results = chosen.out / "results"
    results.mkdir(parents=True, exist_ok=True)
    notes, own, beside = Console(stderr=True), code(), code_of_baselines()
    try:
        methods = other_methods() if chosen.baselines else {}
    except ModuleNotFoundError as error:
        parser.error(str(error))
    specs = plan(block, chosen.count, chosen.seed)[part - 1 :: parts]
    rows: list[Row] = []
    others: dict[str, list[Row]] = {method: [] for method in methods}
    for spec in track(specs, "diagnosing", console=notes, transient=True, disable=not notes.is_terminal):
        name = spec.pop("name")
        dataset, truth_file = chosen.out / name, chosen.out / f"{name}.truth.json"
        if not truth_file.exists():
            make(dataset, **spec, truth=truth_file)
        deleted = tuple(e["name"] for e in spec.get("effects", ())) if chosen.block == "deleted" else ()
        file = f"{name}_{chosen.block}"
        verdict = kept(results / f"{file}_{own}.json", partial(verdict_of, dataset, deleted))
        found = {
            method: kept(results / f"{file}_{method}_{beside}.json", partial(answer, dataset, deleted))
            for method, answer in methods.items()
        }
        truth = json.loads(truth_file.read_text("utf-8"))
        rows.append(Row(name, truth, verdict, score(truth, verdict, deleted)))
        for method, other in found.items():
            # Whether anything is left to name is the dataset's own: all are held against the same refitted device.
            judged = {**other, "gap": verdict.get("gap", {})}
            others[method].append(Row(name, truth, other, score(truth, judged, deleted)))
    report(rows, others, as_json=chosen.json)


if __name__ == "__main__":
    main()
