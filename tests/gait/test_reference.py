"""Gait references: the default reference, files of a user, and invalid files."""

import math
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import mujoco
import numpy as np
import pytest

from klute_sim.device.device import load_device
from klute_sim.errors import InputError
from klute_sim.gait import reference
from klute_sim.gait.rig import trajectory
from klute_sim.gait.rig.build import build_gait_model, measure_leg
from klute_sim.gait.rig.setup import GaitOptions, build_gait_rig

TEXT = (resources.files("klute_sim.gait") / "normative_gait.csv").read_text("utf-8")
DEFAULT = reference.load_default_reference()
PHASE = np.arange(0, 1, 0.001)


def test_default_reference_has_the_published_peaks() -> None:
    angle, moment, power = (
        DEFAULT(c, PHASE)
        for c in ("ankle_dorsiflexion_deg", "ankle_plantarflexor_moment_nm_per_kg", "ankle_power_w_per_kg")
    )
    assert (angle.max(), 100 * PHASE[angle.argmax()]) == pytest.approx((11.4, 44), abs=0.5)
    assert (angle.min(), 100 * PHASE[angle.argmin()]) == pytest.approx((-17.6, 64), abs=1.0)
    assert (moment.max(), 100 * PHASE[moment.argmax()]) == pytest.approx((1.43, 48), abs=1.0)
    assert (power.max(), 100 * PHASE[power.argmax()]) == pytest.approx((3.30, 54), abs=0.5)
    vertical = DEFAULT("grf_vertical_n_per_kg", PHASE)
    assert vertical.mean() == pytest.approx(4.88, abs=0.03)
    # net ankle work: the area of the moment-angle loop
    rate = -np.radians(DEFAULT("ankle_dorsiflexion_deg", PHASE, 1))
    assert (moment * rate).mean() == pytest.approx(0.215, abs=0.003)
    # and the stride time reproduces power from moment and angle
    assert np.sqrt(np.mean((moment * rate / reference.DEFAULT_STRIDE_TIME - power) ** 2)) < 0.12


def test_splines_are_periodic_in_value_and_slope() -> None:
    for column in reference.REQUIRED_COLUMNS:
        for order in (0, 1, 2):
            ends = DEFAULT(column, np.array([0.0, 1.0]), order)
            assert ends[0] == pytest.approx(ends[1], abs=1e-8), (column, order)


def test_segment_angles_are_consistent() -> None:
    flat = PHASE[(PHASE >= 0.14) & (PHASE <= 0.36)]
    shank = DEFAULT("shank_forward_deg", flat)
    assert shank == pytest.approx(DEFAULT("knee_flexion_deg", flat) - DEFAULT("hip_flexion_deg", flat) + 4.03, abs=0.05)
    # 1.2 degrees at the table's rows; closing the cycle moves each angle by up to another 0.2
    assert np.abs(shank - DEFAULT("ankle_dorsiflexion_deg", flat)).max() < 1.6


def test_deviation_columns_are_optional() -> None:
    rows = [line.split(",") for line in TEXT.splitlines()]
    keep = [i for i, name in enumerate(rows[0]) if "_sd_" not in name]
    text = "\n".join(",".join(row[i] for i in keep) for row in rows)
    assert not reference.parse_reference(text, "x").has_column("ankle_dorsiflexion_sd_deg")
    assert DEFAULT.has_column("ankle_dorsiflexion_sd_deg")


def change_column(text: str, column: str, change: Callable[[float], float]) -> str:
    rows = [line.split(",") for line in text.splitlines()]
    where = rows[0].index(column)
    for row in rows[1:]:
        row[where] = repr(change(float(row[where])))
    return "\n".join(map(",".join, rows))


def without_column(text: str) -> str:
    return text.replace("knee_flexion_deg", "knee_bend_deg", 1)


@pytest.mark.parametrize(
    ("corrupt", "message"),
    [
        (without_column, "column 'knee_flexion_deg' is missing"),
        (lambda t: t.replace("\n4,", "\nnan,", 1), "column 'gait_pct', row 4"),
        (lambda t: t.replace("\n4,", "\n1,", 1), "must increase from 0 to 100"),
        (lambda t: t.replace("\n100,", "\n99,", 1), "must increase from 0 to 100"),
        (lambda t: t.replace("27.10", "", 1), "column 'hip_flexion_deg', row 3: '' is not a number from -10000"),
        (lambda t: t.replace("27.10", "1e308", 1), "row 3: '1e308' is not a number from -10000 to 10000"),
        (lambda t: t.replace("\n4,", "\n2.0000000001,", 1), "by 0.001 or more from row to row"),
        (lambda t: t.replace("27.10", "inf", 1), "row 3"),
        (lambda t: t.replace("27.10,", "27.10,5,", 1), "row 3 has 13 cells"),
        (lambda t: t.replace("\n100,26.75,2.48", "\n100,26.75,40.0", 1), "'knee_flexion_deg' is not periodic"),
        (lambda t: t.replace(",3.93,", ",-3.93,", 1), "is negative; allowed: 0 or more"),
        (lambda t: "\n".join(t.splitlines()[:5]), "at least 9 rows"),
        (lambda t: "", "at least 9 rows"),
        (lambda t: t.replace("\n50,", "\n50," + "9" * 140_000, 1), "is not a CSV file"),
        (
            lambda t: change_column(t, "grf_vertical_n_per_kg", lambda v: v + 1.0),
            "never falls below 0.20 N/kg in swing",
        ),
        (lambda t: change_column(t, "knee_flexion_deg", lambda v: 0.3 * v), "allowed: up to 30; check the signs"),
        (lambda t: change_column(t, "knee_flexion_deg", lambda v: -v), "`knee_flexion_deg` has the opposite sign"),
    ],
)
def test_invalid_reference_is_refused_with_place_and_reason(corrupt: Callable[[str], str], message: str) -> None:
    with pytest.raises(InputError) as caught:
        reference.parse_reference(corrupt(TEXT), "mine.csv")
    assert message in str(caught.value)
    assert "mine.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_byte_order_mark_and_blank_lines_are_accepted(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_bytes(("\ufeff" + TEXT + "\n\n").replace("\n", "\r\n").encode())
    assert reference.load_reference(tmp_path / "r.csv")("knee_flexion_deg", PHASE) == pytest.approx(
        DEFAULT("knee_flexion_deg", PHASE)
    )


def test_a_missing_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be read: No such file"):
        reference.load_reference(tmp_path / "none.csv")


def test_ground_reaction_in_newtons_is_refused() -> None:
    with pytest.raises(InputError, match="N/kg"):
        reference.parse_reference(change_column(TEXT, "grf_vertical_n_per_kg", lambda v: 75 * v), "x")


def test_speed_follows_from_legs_and_stride_time() -> None:
    model = build_gait_model(load_device("klute-1-1-4-pair"), mass=75, stature=1.75, dt=5e-4)
    plan = trajectory.plan_hip_trajectory(DEFAULT, measure_leg(model), 1.10)
    assert plan.speed == pytest.approx(1.18, abs=0.01)
    slower = trajectory.plan_hip_trajectory(DEFAULT, measure_leg(model), 1.10, speed=0.8)
    assert slower.speed == pytest.approx(0.8)
    assert slower.stride_length == pytest.approx(plan.stride_length, rel=1e-6)
    assert slower.stride_time == pytest.approx(1.10 * plan.speed / 0.8, rel=1e-6)
    taller = trajectory.plan_hip_trajectory(
        DEFAULT, measure_leg(build_gait_model(load_device("klute-1-1-4-pair"), mass=75, stature=1.925, dt=5e-4)), 1.10
    )
    assert taller.speed == pytest.approx(1.1 * plan.speed, rel=0.01)


def test_stride_time_of_a_reference_sets_the_speed(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(TEXT)
    assert reference.load_reference(tmp_path / "r.csv", 1.3).stride_time == 1.3
    for bad in (0.0, -1.0, float("nan"), 9.0):
        with pytest.raises(InputError, match="stride time is"):
            reference.load_reference(tmp_path / "r.csv", bad)


def test_model_scales_with_the_subject() -> None:
    device = load_device("klute-1-1-4-pair")
    model, scaled_model = (build_gait_model(device, mass=m, stature=s, dt=5e-4) for m, s in ((75, 1.75), (90, 1.925)))
    assert scaled_model.body_mass.sum() == pytest.approx(90)
    assert model.body_mass.sum() == pytest.approx(75)
    for limb in ("thigh", "residual_limb", "socket"):
        a, b = model.body(limb).id, scaled_model.body(limb).id
        assert scaled_model.body_mass[b] == pytest.approx(1.2 * model.body_mass[a])
        assert scaled_model.body_inertia[b] == pytest.approx(1.2 * 1.21 * model.body_inertia[a])
        assert scaled_model.body_ipos[b] == pytest.approx(1.1 * model.body_ipos[a])
    for part in ("prosthesis_pylon", "prosthesis_foot", "prosthesis_heel"):
        assert scaled_model.body_mass[scaled_model.body(part).id] == model.body_mass[model.body(part).id]
    a, b = measure_leg(model), measure_leg(scaled_model)
    assert (b.thigh, b.shank, b.scale) == pytest.approx((0.473, 0.473, 1.1))
    assert (a.thigh, a.shank, a.scale) == pytest.approx((0.43, 0.43, 1.0))
    assert b.sole == pytest.approx(1.1 * a.sole)
    data = mujoco.MjData(scaled_model)
    mujoco.mj_forward(scaled_model, data)
    assert data.ten_length[0] == pytest.approx(0.975 * 0.264 + 0.1)


def test_prescribed_velocities_are_the_derivatives_of_prescribed_positions() -> None:
    model = build_gait_model(load_device("klute-1-1-4-pair"), mass=75, stature=1.75, dt=5e-4)
    plan = trajectory.plan_hip_trajectory(DEFAULT, measure_leg(model), 1.10)
    d = 1e-5
    inside = PHASE[1:]
    slope = (plan.travel(inside + d) - plan.travel(inside - d)) / (2 * d)
    assert slope == pytest.approx(plan.velocity(inside), abs=1e-5)
    for angle in (trajectory.compute_thigh_angle, trajectory.compute_knee_angle):
        slope = (angle(DEFAULT, PHASE + d) - angle(DEFAULT, PHASE - d)) / (2 * d)
        assert slope == pytest.approx(angle(DEFAULT, PHASE, 1), abs=1e-4)


def test_hip_hike_compensates_missing_dorsiflexion() -> None:
    """The default reference is unchanged; a reference with 8 degrees of dorsiflexion in swing needs a higher hip."""
    limb = measure_leg(build_gait_model(load_device("klute-1-1-4-pair"), mass=75, stature=1.75, dt=1e-3))
    default_trajectory = trajectory.plan_hip_trajectory(DEFAULT, limb, 1.10)
    rows = [line.split(",") for line in TEXT.splitlines()]
    ankle, phase = rows[0].index("ankle_dorsiflexion_deg"), rows[0].index("gait_pct")
    for row in rows[1:]:
        row[ankle] = repr(float(row[ankle]) + 8.0 * math.exp(-(((float(row[phase]) - 84.0) / 6.0) ** 2)))
    lifted = trajectory.plan_hip_trajectory(reference.parse_reference("\n".join(map(",".join, rows)), "x"), limb, 1.10)
    swing, stance = PHASE[(PHASE > 0.70) & (PHASE < 0.96)], PHASE[(PHASE > 0.1) & (PHASE < 0.58)]
    shank = np.radians(DEFAULT("shank_forward_deg", swing))
    thigh = trajectory.compute_thigh_angle(DEFAULT, swing)
    passive = np.minimum(
        np.radians(DEFAULT("ankle_dorsiflexion_deg", swing)), np.radians(trajectory.MAX_PASSIVE_DORSIFLEXION_DEG)
    )
    touches = limb.compute_ankle_height(shank - passive) + limb.shank * np.cos(shank) + limb.thigh * np.cos(thigh)
    assert (default_trajectory.height(swing) - touches).min() > trajectory.MIN_TOE_CLEARANCE
    assert (lifted.height(swing) - touches).min() > trajectory.MIN_TOE_CLEARANCE - 2e-4
    assert lifted.height(stance) == pytest.approx(default_trajectory.height(stance), abs=2e-3)


@pytest.mark.parametrize(("stance", "is_walking"), [(0.7, True), (0.55, True), (0.45, False), (0.38, False)])
def test_running_is_refused_by_the_rig(stance: float, is_walking: bool) -> None:
    """With less than half of the cycle in stance, no leg tells the speed of the hip while both feet are in the air."""
    phase = np.linspace(0.0, 1.0, 101)
    rows = [",".join((reference.PHASE_COLUMN, *reference.REQUIRED_COLUMNS))]
    source = np.interp(phase, [0.0, stance, 1.0], [0.0, 0.633, 1.0])
    columns = [DEFAULT(name, source) for name in reference.REQUIRED_COLUMNS]
    columns = [
        np.where(phase < stance, values, 0.0) if name.startswith("grf") else values
        for name, values in zip(reference.REQUIRED_COLUMNS, columns, strict=True)
    ]
    rows += [",".join(f"{value:.6g}" for value in row) for row in zip(100.0 * phase, *columns, strict=True)]
    gait = reference.parse_reference("\n".join(rows), "mine.csv")
    if is_walking:
        assert build_gait_rig(load_device("klute-1-1-4-pair"), GaitOptions(reference=gait), 1e-3).trajectory.speed > 0.5
    else:
        with pytest.raises(InputError, match=r"reference mine\.csv: both feet are in the air in .* as in running"):
            build_gait_rig(load_device("klute-1-1-4-pair"), GaitOptions(reference=gait), 1e-3)
