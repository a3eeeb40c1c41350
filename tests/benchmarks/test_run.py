"""Test the order in which a run of the benchmark works."""

from collections import Counter

import pytest
from benchmarks.hidden_effects.plan import BLOCK_SIZES
from benchmarks.hidden_effects.run import plan_run

BLOCKS = ("clean", "single", "pair", "defective")


@pytest.mark.parametrize("done", [0.1, 0.5, 0.9])
def test_interrupted_run_has_the_same_share_of_every_block(done: float) -> None:
    specs = plan_run(BLOCKS, None, seed=1)
    finished = Counter(spec["block"] for spec in specs[: round(done * len(specs))])
    for block in BLOCKS:
        assert finished[block] == pytest.approx(done * BLOCK_SIZES[block], abs=1)


def test_shards_are_the_whole_run() -> None:
    names = [spec["name"] for spec in plan_run(BLOCKS, None, seed=1)]
    shards = [spec["name"] for part in "12" for spec in plan_run(BLOCKS, None, seed=1, shard=f"{part}/2")]
    assert sorted(shards) == sorted(names) == sorted(set(names))
