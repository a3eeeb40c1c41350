"""The subject of a command: numbers of the reference, overrides, and assumed standard deviations."""

from pathlib import Path

import numpy as np
import pytest

from klute_sim.errors import InputError
from klute_sim.gait.assumed_deviations import CURVE_OF_DEVIATION, assume_standard_deviations
from klute_sim.gait.reference import DEVIATION_COLUMNS, load_default_reference, load_reference
from klute_sim.gait.subject import Subject, resolve_subject
from klute_sim.tuning.objective import HUMAN_GOALS
from klute_sim.tuning.subject import describe_assumptions, make_human_goals, prepare_subject
from tests.gait.reference_files import write_reference, write_reference_folder

PHASE = np.linspace(0.0, 0.99, 50)


def test_numbers_come_from_the_user_then_the_reference_then_the_model(tmp_path: Path) -> None:
    folder = write_reference_folder(tmp_path / "me", mass=62.0, stature=1.66, stride_time=1.2)
    subject = resolve_subject(folder)
    assert (subject.mass, subject.stature, subject.reference.stride_time) == (62.0, 1.66, 1.2)
    subject = resolve_subject(folder, mass=70.0, stature=1.7, stride_time=1.0, speed=1.1, slope=2.0)
    assert (subject.mass, subject.stature, subject.reference.stride_time) == (70.0, 1.7, 1.0)
    assert (subject.speed, subject.slope_deg) == (1.1, 2.0)
    assert resolve_subject(load_reference(folder), stride_time=1.0).reference.stride_time == 1.0
    assert resolve_subject() == Subject()
    assert (Subject().mass, Subject().stature) == (75.0, 1.75)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mass": 7.0}, "mass is 7; allowed: 20 to 250 kg"),
        ({"stature": 3.0}, "stature is 3; allowed: 1 to 2.4 m"),
        ({"speed": 9.0}, "speed is 9; allowed: 0.4 to 2.5 m/s"),
        ({"slope": 30.0}, "slope is 30; allowed: -10 to 10 degrees"),
        ({"stride_time": 1.0}, "a stride time requires a reference file"),
        ({"reference": load_default_reference(), "stride_time": 9.0}, "stride time is 9; allowed: 0.5 to 3 s"),
        ({"reference": "nobody"}, "reference nobody cannot be read"),
    ],
)
def test_invalid_number_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        resolve_subject(**options)  # type: ignore[arg-type]


def test_description_changes_with_every_number_and_with_the_curves(tmp_path: Path) -> None:
    file = write_reference(tmp_path / "a.csv")
    descriptions = [
        resolve_subject(file, **options).describe()  # type: ignore[arg-type]
        for options in ({}, {"mass": 70.0}, {"stature": 1.8}, {"speed": 1.0}, {"slope": 1.0}, {"stride_time": 1.0})
    ]
    other = resolve_subject(write_reference(tmp_path / "b.csv", load_ratio=1.1)).describe()
    assert len({str(description) for description in [*descriptions, other]}) == 7


def test_missing_standard_deviations_scale_with_the_range_of_the_curve(tmp_path: Path) -> None:
    bare = load_reference(write_reference(tmp_path / "bare.csv", load_ratio=1.2, with_deviations=False))
    assumed, default = assume_standard_deviations(bare), load_default_reference()
    assert not any(bare.has_column(column) for column in DEVIATION_COLUMNS)
    assert assumed.assumed_deviations == DEVIATION_COLUMNS
    for column, curve in CURVE_OF_DEVIATION.items():
        ratio = 1.0 if curve == "ankle_dorsiflexion_deg" else 1.2
        expected = ratio * default.compute_standard_deviation(column, PHASE)
        assert assumed.compute_standard_deviation(column, PHASE) == pytest.approx(expected, rel=1e-6)


def test_measured_standard_deviations_are_kept_and_hold_elsewhere_only_if_assumed() -> None:
    default = load_default_reference()
    kept, everywhere = assume_standard_deviations(default), assume_standard_deviations(default, everywhere=True)
    assert kept.assumed_deviations == ()
    assert not any(kept.tilt_to_slope(0.05).has_column(column) for column in DEVIATION_COLUMNS)
    assert all(everywhere.tilt_to_slope(0.05).has_column(column) for column in DEVIATION_COLUMNS)
    for column in DEVIATION_COLUMNS:
        assert everywhere(column, PHASE) == pytest.approx(default(column, PHASE))


def test_tuning_states_what_it_assumes(tmp_path: Path) -> None:
    assert describe_assumptions(Subject()) == []
    bare = load_reference(write_reference(tmp_path / "bare.csv", with_deviations=False))
    (missing,) = describe_assumptions(Subject(reference=bare))
    assert "the standard deviations of angle, moment, power are those of able-bodied adults" in missing
    (elsewhere,) = describe_assumptions(Subject(speed=1.4, slope_deg=-3.0))
    assert "at 1.4 m/s and on a slope of -3 degrees" in elsewhere
    assert prepare_subject(Subject(speed=1.4)).reference.assumed_deviations == DEVIATION_COLUMNS


def test_human_goals_scale_with_the_ankle_of_the_reference(tmp_path: Path) -> None:
    assert make_human_goals(load_default_reference()) == HUMAN_GOALS
    goals = make_human_goals(load_reference(write_reference(tmp_path / "strong.csv", load_ratio=1.2)))
    assert goals.moment_sd == HUMAN_GOALS.moment_sd
    assert goals.power_w_per_kg == pytest.approx(1.2 * 3.31)
    assert goals.work_j_per_kg == pytest.approx(1.2 * 0.218)
    assert goals.plantarflexion_deg == pytest.approx(15.0)
