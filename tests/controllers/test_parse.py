"""Controllers from strings."""

from pathlib import Path

import pytest

from klute_sim.controllers.parse import parse_controller
from klute_sim.controllers.pressure import (
    ConstantPressure,
    PressureProfile,
    create_off_controller,
    load_default_profile,
)
from klute_sim.errors import InputError


def test_kinds_create_their_controllers() -> None:
    assert parse_controller("off") == create_off_controller()
    assert parse_controller("profile") == load_default_profile()
    assert parse_controller("constant:3.5") == ConstantPressure(350_000.0)


@pytest.mark.parametrize("spec", ["{}", "profile:{}"])
def test_other_strings_are_files(spec: str, tmp_path: Path) -> None:
    file = tmp_path / "mine.csv"
    file.write_text("gait_pct,pressure_bar\n0,1\n50,3\n")
    assert parse_controller(spec.format(file)) == PressureProfile("mine.csv", (0.0, 50.0), (1.0, 3.0))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("pid", "no controller 'pid'; allowed: profile, off, constant:BAR"),
        ("none.csv", "pressure profile none.csv cannot be read"),
        ("constant", "'constant:' needs a pressure in bar"),
        ("constant:much", "'constant:much' needs a pressure in bar"),
        ("constant:-1", "pressure is -1 bar; allowed: 0 bar or more"),
        ("off:3", "off has no argument"),
    ],
)
def test_invalid_string_is_refused_in_one_sentence(spec: str, message: str) -> None:
    with pytest.raises(InputError, match=r"^[^\n]*$") as raised:
        parse_controller(spec)
    assert message in str(raised.value)
