"""Splitting: whole groups, always the same way, and only where there are enough."""

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
def test_groups_are_kept_back_where_there_are_enough(count: int, expected: tuple[int, int, int]) -> None:
    assert sizes(assign_uses(groups(count), "x")) == expected


@given(count=st.integers(1, 30), order=st.randoms())
def test_whole_groups_are_split_whatever_their_order(count: int, order: random.Random) -> None:
    members = groups(count)
    split = assign_uses(members, "x")
    for kind in split[:3]:
        assert all((f"t{name[1:-2]}_0" in kind) and (f"t{name[1:-2]}_1" in kind) for name in kind)
    assert sorted(split.fit + split.validation + split.test) == sorted(m.name for m in members)
    assert split.fit
    order.shuffle(members)
    again = assign_uses(members, "x")
    assert [set(a) for a in again[:3]] == [set(a) for a in split[:3]]
    assert again.description.count("for show") == split.description.count("for show") == len(split.test) // 2


def test_names_come_in_the_order_of_the_trials() -> None:
    split = assign_uses(groups(12), "x")
    assert list(split.fit) == [m.name for m in groups(12) if m.name in split.fit]


def test_what_the_dataset_says_is_honoured() -> None:
    members = [
        SplitEntry("a", "a", "show"),
        SplitEntry("b", "b", "fit"),
        SplitEntry("c", "c", "select"),
        SplitEntry("d", "d", "fit"),
    ]
    assert assign_uses(members, "x") == (("b", "d"), ("c",), ("a",), "the dataset says the use of all 4 groups")


def test_only_what_is_missing_is_drawn() -> None:
    shown = [SplitEntry("s", "s", "show"), *groups(3, 1)]
    split = assign_uses(shown, "x")
    assert split.test == ("s",)
    assert sizes(split, 1) == (2, 1, 1)
    assert split.description.startswith(
        "the dataset says the use of some groups; of 4 groups, drawn by their names: 'g"
    )
    rest = assign_uses([SplitEntry("s", "s", "show"), SplitEntry("c", "c", "select"), SplitEntry("f", "f", None)], "x")
    assert rest[:3] == (("f",), ("c",), ("s",))
    assert rest.description == "the dataset says the use of some groups; 3 groups: those without a use are fitted"
    fitted = assign_uses([*(SplitEntry(n, n, "fit") for n in "abc"), SplitEntry("d", "d", None)], "x")
    assert fitted[:3] == (("a", "b", "c"), (), ("d",))


def test_something_is_always_left_to_fit() -> None:
    members = [SplitEntry("a", "a", "select"), SplitEntry("b", "b", "select"), SplitEntry("c", "c", None)]
    assert assign_uses(members, "x").fit == ("c",)
    with pytest.raises(InputError, match=r"^x: no trial is left to fit; allowed: use = 'fit' for at least one group$"):
        assign_uses([SplitEntry("a", "a", "show"), SplitEntry("b", "b", "select")], "x")


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_groups_are_all_fitted_and_it_says_so(count: int) -> None:
    how = assign_uses(groups(count), "x").description
    assert how == f"{count} group{'s' * (count - 1)}: too few to keep one back, so everything without a use is fitted"


def test_how_names_the_groups_drawn() -> None:
    split = assign_uses(groups(4, 1), "x")
    drawn = dict(re.findall(r"'g(\d)' for (\w+)", split.description))
    assert {f"t{g}_0": use for g, use in drawn.items()} == {split.test[0]: "show", split.validation[0]: "select"}
    assert split.description.endswith("; the others are fitted")


@pytest.mark.parametrize("uses", [("fit", "show"), ("fit", None), (None, "show")])
def test_repeats_used_differently_are_refused(uses: tuple) -> None:
    members = [SplitEntry("a", "g", uses[0]), SplitEntry("b", "g", uses[1])]
    with pytest.raises(InputError, match=r"^x: group 'g' has trials with .* and .*; give repeats the same use$"):
        assign_uses(members, "x")
