"""Split of a dataset: whole groups, reproducibly, and only with enough groups."""

import random
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.datasets.split import Split, SplitEntry, assign_uses
from klute_sim.errors import InputError


def groups(count: int, repeats: int = 2) -> list[SplitEntry]:
    return [SplitEntry(f"t{g}_{r}", f"g{g}", None) for g in range(count) for r in range(repeats)]


def sizes(split: Split, repeats: int = 2) -> tuple[float, float, float]:
    return len(split.fit) / repeats, len(split.validation) / repeats, len(split.test) / repeats


@pytest.mark.parametrize(
    ("count", "expected"),
    [(1, (1, 0, 0)), (2, (2, 0, 0)), (3, (2, 0, 1)), (4, (2, 1, 1)), (5, (3, 1, 1)), (9, (7, 1, 1)), (10, (6, 2, 2))],
)
def test_split_holds_out_groups_only_from_enough_groups(count: int, expected: tuple[int, int, int]) -> None:
    assert sizes(assign_uses(groups(count), "x")) == expected


@given(count=st.integers(1, 30), order=st.randoms())
def test_split_keeps_groups_whole_and_is_independent_of_order(count: int, order: random.Random) -> None:
    entries = groups(count)
    split = assign_uses(entries, "x")
    for kind in split[:3]:
        assert all((f"t{name[1:-2]}_0" in kind) and (f"t{name[1:-2]}_1" in kind) for name in kind)
    assert sorted(split.fit + split.validation + split.test) == sorted(m.name for m in entries)
    assert split.fit
    order.shuffle(entries)
    again = assign_uses(entries, "x")
    assert [set(a) for a in again[:3]] == [set(a) for a in split[:3]]
    assert again.description.count("for test") == split.description.count("for test") == len(split.test) // 2


def test_split_lists_names_in_the_order_of_the_trials() -> None:
    split = assign_uses(groups(12), "x")
    assert list(split.fit) == [m.name for m in groups(12) if m.name in split.fit]


def test_split_follows_the_uses_in_the_dataset() -> None:
    entries = [
        SplitEntry("a", "a", "test"),
        SplitEntry("b", "b", "fit"),
        SplitEntry("c", "c", "validation"),
        SplitEntry("d", "d", "fit"),
    ]
    assert assign_uses(entries, "x") == (("b", "d"), ("c",), ("a",), "the dataset specifies the use of all 4 groups")


def test_split_draws_only_the_missing_uses() -> None:
    entries = [SplitEntry("s", "s", "test"), *groups(3, 1)]
    split = assign_uses(entries, "x")
    assert split.test == ("s",)
    assert sizes(split, 1) == (2, 1, 1)
    assert split.description.startswith(
        "the dataset specifies the use of some groups; of 4 groups, chosen by a fixed rule from their names: 'g"
    )
    partial = assign_uses(
        [SplitEntry("s", "s", "test"), SplitEntry("c", "c", "validation"), SplitEntry("f", "f", None)], "x"
    )
    assert partial[:3] == (("f",), ("c",), ("s",))
    assert (
        partial.description == "the dataset specifies the use of some groups; 3 groups: those without a use are fitted"
    )
    fitted = assign_uses([*(SplitEntry(n, n, "fit") for n in "abc"), SplitEntry("d", "d", None)], "x")
    assert fitted[:3] == (("a", "b", "c"), (), ("d",))


@given(count=st.integers(4, 20), moving=st.sets(st.integers(0, 19), min_size=1))
def test_split_fits_a_trial_of_each_varied_channel(count: int, moving: set[int]) -> None:
    varied = [frozenset({"length"} if g in moving else ()) for g in range(count)]
    split = assign_uses([SplitEntry(f"t{g}", f"g{g}", None, each) for g, each in enumerate(varied)], "x")
    assert not any(varied) or any(varied[int(name[1:])] for name in split.fit)
    assert sizes(split, 1) == sizes(assign_uses(groups(count, 1), "x"), 1)


def test_split_draws_groups_that_alone_vary_a_channel_if_there_are_no_others() -> None:
    entries = [SplitEntry(f"t{g}", f"g{g}", None, frozenset({f"channel {g}"})) for g in range(5)]
    assert sizes(assign_uses(entries, "x"), 1) == (3, 1, 1)


def test_split_always_leaves_a_trial_to_fit() -> None:
    entries = [SplitEntry("a", "a", "validation"), SplitEntry("b", "b", "validation"), SplitEntry("c", "c", None)]
    assert assign_uses(entries, "x").fit == ("c",)
    with pytest.raises(InputError, match=r"^x: no trial is left to fit; set use = 'fit' for at least one group$"):
        assign_uses([SplitEntry("a", "a", "test"), SplitEntry("b", "b", "validation")], "x")


@pytest.mark.parametrize("count", [1, 2])
def test_split_fits_all_of_too_few_groups(count: int) -> None:
    description = assign_uses(groups(count), "x").description
    assert (
        description
        == f"{count} group{'s' * (count - 1)}: too few to hold one out, so all groups without a use are fitted"
    )


def test_split_description_names_the_drawn_groups() -> None:
    split = assign_uses(groups(4, 1), "x")
    drawn = dict(re.findall(r"'g(\d)' for (\w+)", split.description))
    assert {f"t{g}_0": use for g, use in drawn.items()} == {split.test[0]: "test", split.validation[0]: "validation"}
    assert split.description.endswith("; the others are fitted")


@pytest.mark.parametrize("uses", [("fit", "test"), ("fit", None), (None, "test")])
def test_split_refuses_repeats_with_different_uses(uses: tuple) -> None:
    entries = [SplitEntry("a", "g", uses[0]), SplitEntry("b", "g", uses[1])]
    with pytest.raises(InputError, match=r"^x: group 'g' has trials with .* and .*; give all repeats the same use$"):
        assign_uses(entries, "x")
