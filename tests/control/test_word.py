"""Controllers in one word."""

from pathlib import Path

import pytest

from klute_sim.control.pressure import Constant, Profile, off, tuned
from klute_sim.control.word import parse
from klute_sim.errors import InputError


def test_kinds_and_what_they_need() -> None:
    assert parse("off") == off()
    assert parse("profile") == tuned()
    assert parse("constant:3.5") == Constant(350_000.0)


@pytest.mark.parametrize("word", ["{}", "profile:{}"])
def test_anything_else_is_a_file(word: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    file.write_text("gait_pct,pressure_bar\n0,1\n50,3\n")
    assert parse(word.format(file)) == Profile("mine.csv", (0.0, 50.0), (1.0, 3.0))


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("pid", "no controller 'pid'; allowed: profile, off, constant:BAR"),
        ("none.csv", "pressure profile none.csv cannot be read"),
        ("constant", "'constant:' needs a pressure in bar"),
        ("constant:much", "'constant:much' needs a pressure in bar"),
        ("constant:-1", "pressure is -1 bar; allowed: 0 bar or more"),
        ("off:3", "off takes nothing after it"),
    ],
)
def test_bad_words_are_one_sentence(word: str, says: str) -> None:
    with pytest.raises(InputError, match=r"^[^\n]*$") as raised:
        parse(word)
    assert says in str(raised.value)
