"""Diagnose datasets with hidden effects and hold the verdicts against the truth.

    python benchmarks/hidden_effects/run.py OUT --block single --count 20 --seed 1

Datasets are made where they are missing, every result is saved as soon as it is there, and what has been done with
this code is not done again: interrupt it and start it again as you like. ``--shard 2/4`` does the second quarter, for
several machines that share OUT. Block ``deleted`` takes block ``single`` with the true effect struck from the
catalogue. The truth is opened only after the verdict is on the disk.
"""

import argparse
import hashlib
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from generate import make
from plan import BLOCKS, plan
from rich.console import Console
from rich.progress import track
from rich.table import Table
from score import hidden, kinds_confused, named, score, size

ROOT = Path(__file__).parents[2]


def code() -> str:
    """Digest of everything that decides a verdict."""
    parts = ("laws", "effects", "device", "dataset", "diagnose")
    files = sorted(file for part in parts for file in (ROOT / "src" / "klute_sim" / part).rglob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12]


def verdict_of(dataset: Path, exclude: tuple[str, ...]) -> dict[str, Any]:
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
    found: dict[str, Any] = json.loads(done.stdout)
    return found | {"s": seconds}


def main() -> None:
    """Make, diagnose, score, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of datasets and results")
    parser.add_argument("--block", choices=(*BLOCKS, "deleted"), required=True)
    parser.add_argument("--count", type=int, default=20, help="datasets of the block  [default: 20]")
    parser.add_argument("--seed", type=int, default=1, help="of the block  [default: 1]")
    parser.add_argument("--shard", default="1/1", metavar="I/N", help="do the I-th of N parts  [default: 1/1]")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    chosen = parser.parse_args()
    part, parts = (int(x) for x in chosen.shard.split("/"))
    block = "single" if chosen.block == "deleted" else chosen.block
    results = chosen.out / "results"
    results.mkdir(parents=True, exist_ok=True)
    notes, own = Console(stderr=True), code()
    specs = plan(block, chosen.count, chosen.seed)[part - 1 :: parts]
    rows = []
    for spec in track(specs, "diagnosing", console=notes, transient=True, disable=not notes.is_terminal):
        name = spec.pop("name")
        dataset, truth_file = chosen.out / name, chosen.out / f"{name}.truth.json"
        if not truth_file.exists():
            make(dataset, **spec, truth=truth_file)
        kept = results / f"{name}_{chosen.block}_{own}.json"
        deleted = tuple(e["name"] for e in spec.get("effects", ())) if chosen.block == "deleted" else ()
        if not kept.exists():
            verdict = verdict_of(dataset, deleted)
            fresh = kept.with_suffix(".unfinished")
            fresh.write_text(json.dumps(verdict, indent=1), "utf-8")
            fresh.rename(kept)
        verdict, truth = json.loads(kept.read_text("utf-8")), json.loads(truth_file.read_text("utf-8"))
        rows.append((name, truth, verdict, score(truth, verdict, deleted)))
    report(rows, as_json=chosen.json)


def report(rows: list[tuple[str, Any, Any, str]], *, as_json: bool) -> None:
    """The outcome of every dataset, and how often each."""
    counts = {word: sum(row[3] == word for row in rows) for word in dict.fromkeys(row[3] for row in rows)}
    whole = {
        "datasets": len(rows),
        "outcomes": counts,
        "kinds_confused": sum(kinds_confused(truth, verdict) for _, truth, verdict, _ in rows),
        "median_s": statistics.median(verdict["s"] for _, _, verdict, _ in rows),
    }
    listed = [
        {
            "dataset": name,
            "hidden": hidden(truth),
            "raw_size": truth["raw_size"],
            "size": size(verdict),
            "verdict": verdict["verdict"],
            "named": named(verdict),
            "alternatives": verdict["alternatives"],
            "outcome": outcome,
        }
        for name, truth, verdict, outcome in rows
    ]
    if as_json:
        print(json.dumps({**whole, "rows": listed}, indent=2))
        return
    table = Table("dataset", "hidden", "raw size", "size", "verdict", "named", "outcome")
    for row in listed:
        told = ", ".join(row["named"]) + ("".join(f" | {', '.join(a)}" for a in row["alternatives"]))
        sizes = f"{row['raw_size']:.1f}", f"{row['size']:.1f}"
        table.add_row(row["dataset"], ", ".join(row["hidden"]), *sizes, row["verdict"], told, row["outcome"])
    out = Console(width=150, highlight=False)
    out.print(table)
    out.print(whole)


if __name__ == "__main__":
    main()
