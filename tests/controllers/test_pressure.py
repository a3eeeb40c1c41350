"""Pressure controllers over the gait phase."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from klute_sim.controllers import pressure
from klute_sim.controllers.pressure import ConstantPressure, PressureProfile
from klute_sim.errors import InputError


def test_default_profile_is_within_the_limits_of_the_supply() -> None:
    phase = np.arange(0, 1, 5e-4)
    command = np.array([pressure.load_default_profile().pressure_at(p) for p in phase])
    assert command.min() >= 0.0
    assert command.max() <= 5e5
    assert np.abs(np.gradient(command, phase * 1.1)).max() < 50e5


@given(
    st.lists(st.tuples(st.floats(0, 99), st.floats(0, 6)), min_size=2, max_size=8, unique_by=lambda k: round(k[0], 1)),
    st.floats(0, 3),
)
def test_profile_interpolates_its_knots_without_overshoot(knots: list[tuple[float, float]], phase: float) -> None:
    knots = sorted(knots)
    profile = PressureProfile("x", tuple(k[0] for k in knots), tuple(k[1] for k in knots))
    low, high = min(profile.pressure_bar), max(profile.pressure_bar)
    assert low * 1e5 - 1e-6 <= profile.pressure_at(phase) <= high * 1e5 + 1e-6
    assert profile.pressure_at(phase % 1.0) == pytest.approx(profile.pressure_at(phase % 1.0 + 1.0), rel=1e-6, abs=1e-3)
    for where, value in knots:
        assert profile.pressure_at(where / 100) == pytest.approx(1e5 * value, abs=1e-3)


def test_constant_and_off_controllers() -> None:
    assert ConstantPressure(2e5).pressure_at(0.3) == 2e5
    assert pressure.create_off_controller().pressure_at(0.9) == 0.0
    for bad in (-1.0, float("nan"), float("inf")):
        with pytest.raises(InputError, match="0 bar or more"):
            ConstantPressure(bad)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("phase,bar\n0,1\n50,2\n", "heading must be 'gait_pct,pressure_bar'"),
        ("", "heading must be"),
        ("gait_pct,pressure_bar\n0,1\n", "at least two rows"),
        ("gait_pct,pressure_bar\n0,1\n50,high\n", "row 3 is not two numbers"),
        ("gait_pct,pressure_bar\n0,1\n50\n", "row 3 is not two numbers"),
        ("gait_pct,pressure_bar\n0,1\n50,-2\n", "0 or more"),
        ("gait_pct,pressure_bar\n0,1\n50,nan\n", "0 or more"),
        ("gait_pct,pressure_bar\n50,1\n0,2\n", "must increase"),
        ("gait_pct,pressure_bar\n0,1\n100,2\n", "less than 100"),
    ],
)
def test_invalid_profiles_are_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "p.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message):
        pressure.load_profile(file)
