"""Each importer on a made walker whose every number is known: the package's own reference."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from klute_sim.errors import InputError
from klute_sim.gait import reference
from klute_sim.mocap import reference_import, trial
from klute_sim.mocap.formats import storage, trc
from klute_sim.mocap.formats.storage import Storage
from klute_sim.mocap.import_log import ImportLog
from klute_sim.mocap.options import ImportOptions
from klute_sim.mocap.parsing import mapping, sources
from klute_sim.mocap.reference_import import ImportedReference
from klute_sim.mocap.strides.leg import LegChannels
from tests import synthetic_gait as made
from tests.synthetic_gait import HUMAN, LATER, MASS, PERIOD, Walker

RAW = ImportOptions(mass=MASS, motion_cutoff=0.0, load_cutoff=0.0, ankle_zero="file")
"""No filters and no moved zero, so that numbers can be followed by hand."""

ROW_30 = {
    "hip_angle": 4.62 - 0.3 * (26.75 - 27.28),
    "knee_angle": 8.84 - 0.3 * (2.48 - 3.65),
    "ankle_angle": 8.02 - 0.3 * (-0.25 + 0.52),
    "shank_angle": 8.26 - 0.3 * (-20.24 + 19.59),
    "ankle_moment": 70 * 0.6909,
    "grf_vertical": 70 * 7.7176,
    "grf_forward": 70 * -0.2597,
}
"""The row of 30 % in the package's table, of a walker of 70 kg; of angles, less 30 % of what 100 % differs from 0 %."""


def opensim(folder: Path) -> list[Path]:
    return made.opensim(folder, Walker())


def older_knee(folder: Path) -> list[Path]:
    return made.opensim(folder, Walker(), knee_sign=-1.0)


def treadmill(folder: Path) -> list[Path]:
    return [made.treadmill(folder, Walker())]


def table_in_parquet(folder: Path) -> list[Path]:
    rows = np.genfromtxt(made.treadmill(folder, Walker()), delimiter=",", names=True)
    columns = {name: rows[name] for name in rows.dtype.names}
    for name in [n for n in columns if n.endswith("Angle")]:
        columns[f"{name} [deg]"] = np.degrees(columns.pop(name))
    pq.write_table(pa.table(columns), folder / "t.parquet")
    return [folder / "t.parquet"]


def markers(folder: Path) -> list[Path]:
    trc.write(made.markers(Walker()), folder / "m.trc")
    return [folder / "m.trc", opensim(folder)[1]]


def captured(folder: Path) -> list[Path]:
    pytest.importorskip("ezc3d", reason="the extra 'c3d' is not installed")
    return [made.c3d(folder, Walker())]


def limbs(files: list[Path], options: ImportOptions, findings: ImportLog | None = None) -> dict[str, LegChannels]:
    group = [sources.read(file) for file in files]
    return {limb.side: limb for limb in trial.extract_legs(group, options, findings or ImportLog())}


@pytest.mark.parametrize("files", [opensim, older_knee, treadmill, table_in_parquet, markers, captured])
def test_one_instant_by_hand(files: Callable[[Path], list[Path]], tmp_path: Path) -> None:
    for side, limb in limbs(files(tmp_path), RAW).items():
        when = LATER[side] + 0.3 * PERIOD
        wanted = dict(ROW_30)
        if files in (opensim, older_knee):
            wanted["hip_angle"] = (
                ROW_30["knee_angle"] - ROW_30["shank_angle"] + 4.03
            )  # the pelvis is written tilted by this
        if files in (markers, captured):
            wanted["hip_angle"] = ROW_30["knee_angle"] - ROW_30["shank_angle"]  # against the vertical
            # less what the foot's weight does: 0.0145 of 70 kg, half-way from ankle to toe
            wanted["ankle_moment"] -= 0.0145 * 70 * 9.81 * 0.5 * 0.15
        if files in (treadmill, table_in_parquet):
            # without a pelvis the shank is knee minus hip, moved to where the foot is flat
            wanted["shank_angle"] = limb.channels["shank_angle"][np.searchsorted(limb.time, when - 1e-9)]
            assert wanted["shank_angle"] == pytest.approx(8.26, abs=0.7)
        for name, value in wanted.items():
            found = np.interp(when, limb.time, limb.channels[name])
            # the moment by markers has the foot's inertia, too: small in mid-stance
            near = 0.5 if name == "ankle_moment" and files in (markers, captured) else 0.01
            assert found == pytest.approx(value, abs=near), (side, name)


@pytest.mark.parametrize("files", [opensim, older_knee, treadmill, markers, captured])
def test_the_walker_comes_back_as_the_reference_it_was_made_of(
    files: Callable[[Path], list[Path]], tmp_path: Path
) -> None:
    found = reference_import.import_reference(files(tmp_path), ImportOptions(mass=MASS))
    phase = found.table[reference.PHASE_COLUMN] / 100.0
    # heel strike is where 20 N are passed, 0.3 % later than the reference's; the filters do the rest
    tolerances = {"deg": 1.2, "kg": 0.3}
    for column in reference.REQUIRED_COLUMNS:
        if column == "hip_flexion_deg" and files in (markers, captured):
            continue
        off = np.abs(found.table[column] - HUMAN(column, phase)).max()
        assert off < tolerances[column.split("_")[-1]], column
    assert found.stride_time == pytest.approx(PERIOD, abs=1e-3)
    assert found.toe_off == pytest.approx(63.0, abs=0.6)
    assert found.impulse_mass == pytest.approx(69.5, abs=0.3)  # the reference's own loads carry 0.993 body weights


def edited(path: Path, change: Callable[[str, np.ndarray], np.ndarray | None], degrees: bool | None = None) -> None:
    """Rewrite the storage file at ``path`` with every column changed; None leaves it out."""
    old = storage.read(path)
    columns = {label: change(label, samples) for label, samples in old.columns.items()}
    kept = {label: samples for label, samples in columns.items() if samples is not None}
    storage.write(Storage(kept, old.in_degrees if degrees is None else degrees), path)


def flipped(file: int, part: str) -> Callable[[list[Path]], None]:
    return lambda paths: edited(paths[file], lambda label, s: -s if part in label else s)


def in_radians(paths: list[Path]) -> None:
    edited(paths[0], lambda label, s: s if label in ("time", "pelvis_tx") else np.radians(s), degrees=False)


def in_radians_that_call_themselves_degrees(paths: list[Path]) -> None:
    edited(paths[0], lambda label, s: s if label in ("time", "pelvis_tx") else np.radians(s), degrees=True)


def in_degrees_that_call_themselves_radians(paths: list[Path]) -> None:
    edited(paths[0], lambda label, s: s, degrees=False)


def ankle_against_foot(paths: list[Path]) -> None:
    edited(paths[0], lambda label, s: 90.0 - s if "ankle" in label else s)


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (flipped(0, "knee"), "flexion; its name would say the opposite"),
        (flipped(0, "hip"), "the hip is more flexed at heel strike"),
        (flipped(0, "ankle"), "plantarflexes from late stance"),
        (flipped(1, "vx"), "brakes first"),
        (flipped(1, "v"), "brakes first"),
        (flipped(2, "ankle"), "mean moment in stance"),
        (in_radians, "unit stated"),
        (in_radians_that_call_themselves_degrees, "though the header says deg"),
        (in_degrees_that_call_themselves_radians, "though the header says rad"),
        (ankle_against_foot, "zero is the nearest right angle"),
    ],
)
def test_signs_units_and_zeros_are_found_and_told(
    spoil: Callable[[list[Path]], None], told: str, tmp_path: Path
) -> None:
    paths = opensim(tmp_path)
    plain = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    spoil(paths)
    found = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    for column in reference.REQUIRED_COLUMNS:
        assert found.table[column] == pytest.approx(plain.table[column], abs=1e-6), column
    assert any(told in entry["why"] for entry in found.log.channels)


def test_another_neutral_ankle_is_moved_to_where_the_foot_is_flat_or_left(tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    plain = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    edited(paths[0], lambda label, s: s - 12.0 if "ankle" in label else s)
    moved = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    column = "ankle_dorsiflexion_deg"
    assert moved.table[column] == pytest.approx(plain.table[column])
    assert said(moved, "suspicious", "the right foot is pitched by 11.") or said(moved, "suspicious", "pitched by 12.")
    left = reference_import.import_reference(paths, ImportOptions(mass=MASS, ankle_zero="file"))
    assert left.table[column].mean() == pytest.approx(plain.table[column].mean() - 12.0, abs=0.6)


def test_what_is_given_goes_before_what_is_found(tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    (tmp_path / "map.toml").write_text('[right]\nknee_angle = { column = "knee_angle_r", sign = -1 }\n')
    options = replace(RAW, mapping=mapping.read(tmp_path / "map.toml"))
    findings = ImportLog()
    right = limbs(paths, options, findings)["right"]
    assert np.interp(0.43, right.time, right.channels["knee_angle"]) == pytest.approx(-ROW_30["knee_angle"], abs=0.01)
    assert any(e["channel"] == "knee_angle" and "as given" in e["why"] for e in findings.channels)


def test_a_pelvis_that_tilts_the_other_way_is_told_by_its_owner_alone(tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    plain = limbs(paths, RAW)["right"].channels["shank_angle"]
    edited(paths[0], lambda label, s: -s if "tilt" in label else s)
    (tmp_path / "map.toml").write_text('[body]\npelvis_tilt = { column = "pelvis_tilt", sign = -1 }\n')
    findings = ImportLog()
    mended = limbs(paths, replace(RAW, mapping=mapping.read(tmp_path / "map.toml")), findings)["right"]
    assert mended.channels["shank_angle"] == pytest.approx(plain)
    assert any(e["channel"] == "pelvis_tilt" and e["sign"] == -1 for e in findings.channels)


def test_columns_with_names_nobody_knows_are_mapped(tmp_path: Path) -> None:
    path = made.treadmill(tmp_path, Walker())
    heading, _, rest = path.read_text().partition("\n")
    strange = [f"c{number}" if number else "time" for number, _ in enumerate(heading.split(","))]
    names = dict(zip(heading.split(","), strange, strict=True))
    path.write_text(",".join(strange) + "\n" + rest)
    with pytest.raises(InputError, match="holds nothing of use"):
        reference_import.import_reference([path], RAW)
    wanted = {
        "hip_angle": "HipFlexionAngle",
        "knee_angle": "KneeFlexionAngle",
        "ankle_angle": "AnklePlantarFlexionAngle",
        "ankle_moment": "AnklePlantarFlexionMoment",
        "grf_vertical": "GRF_y",
        "grf_forward": "GRF_x",
    }
    lines = ["[right]", *(f'{channel} = "{names["Right" + name]}"' for channel, name in wanted.items())]
    (tmp_path / "map.toml").write_text("\n".join(lines))
    found = reference_import.import_reference(
        [path], ImportOptions(mass=MASS, mapping=mapping.read(tmp_path / "map.toml"))
    )
    assert list(found.strides) == ["right"]
    assert found.impulse_mass == pytest.approx(69.5, abs=0.3)  # of one foot, twice
    assert found.table["knee_flexion_deg"][30] == pytest.approx(8.84, abs=0.5)


def said(found: ImportedReference, kind: str, part: str) -> bool:
    return any(part in sentence for sentence in getattr(found.log, kind))


def test_the_mass_is_taken_from_the_impulse_and_a_contradiction_is_told(tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    assert reference_import.import_reference(paths, ImportOptions()).mass == pytest.approx(69.5, abs=0.3)
    assert not said(reference_import.import_reference(paths, ImportOptions(mass=70.0)), "suspicious", "contradicts")
    wrong = reference_import.import_reference(paths, ImportOptions(mass=60.0))
    assert said(wrong, "suspicious", "60 kg, contradicts the impulse of the ground reaction, which carries 69.")
    assert wrong.mass == 60.0
    assert wrong.table["grf_vertical_n_per_kg"].max() == pytest.approx(70 / 60 * 11.1, abs=0.3)


def test_a_belt_that_starts_is_left_out(tmp_path: Path) -> None:
    found = reference_import.import_reference(treadmill(tmp_path), ImportOptions(mass=MASS))
    assert said(found, "suspicious", "the belt ramps up or changes its speed: 1 stride of the right leg left out")
    assert min(stride.start for stride in found.strides["right"]) > 1.1
    assert found.walking_speed == pytest.approx(1.2, rel=0.02)
    assert said(found, "suspicious", "is -1.5708 rad (-90 degrees) in standing")
    assert said(found, "suspicious", "are the same for 100 % of the time: one centre of pressure for both feet")


def test_a_clipped_hip_is_told(tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    assert not said(reference_import.import_reference(paths, RAW), "suspicious", "clipped")
    edited(paths[0], lambda label, s: np.maximum(s, 0.0) if "hip" in label else s)
    assert said(reference_import.import_reference(paths, RAW), "suspicious", "stands at 0.0 degrees for")


def test_a_plate_with_an_offset_is_told_and_mended(tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    edited(paths[1], lambda label, s: s + 12.0 if label.endswith("1_vy") else s)
    found = reference_import.import_reference(paths, RAW)
    assert said(found, "suspicious", "plate 1 reads 12.0 N with nobody on it")
    assert found.impulse_mass == pytest.approx(69.5, abs=0.3)


def test_listed_events_are_compared(tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    for late, kind, part in (
        (0.0, "derived", "Check of the events"),
        (0.1, "suspicious", "ms after those found here; those"),
    ):
        strikes = LATER["right"] + PERIOD * np.arange(3) + late + 0.003
        (tmp_path / "events.csv").write_text("rhs\n" + "\n".join(map(str, strikes)) + "\n")
        found = reference_import.import_reference([*paths, tmp_path / "events.csv"], RAW)
        assert said(found, kind, part)
        assert not said(found, "suspicious" if kind == "derived" else "derived", "events.csv")


def test_a_stride_whose_second_heel_strike_is_on_no_plate_ends_by_its_posture(tmp_path: Path) -> None:
    paths = made.opensim(tmp_path, Walker(seconds=1.75))
    edited(paths[1], lambda label, s: np.where(np.arange(len(s)) < 95, s, 0.0) if "force" in label else s)
    found = reference_import.import_reference(paths, ImportOptions(mass=MASS, side="right"))
    (stride,) = found.strides["right"]
    assert stride.duration == pytest.approx(PERIOD, abs=0.011)
    assert said(found, "derived", "posture is that of the first heel strike again")


def test_the_end_of_one_stride_and_the_beginning_of_the_next_make_one(tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    whole = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    old = storage.read(paths[0])
    part = slice(50, 50 + round(100 * PERIOD) - 2)
    storage.write(Storage({label: s[part] for label, s in old.columns.items()}, True), paths[0])
    found = reference_import.import_reference(paths, ImportOptions(mass=MASS, side="right"))
    assert said(found, "suspicious", "put together from the end of one and the beginning of the next")
    assert found.table["knee_flexion_deg"] == pytest.approx(whole.table["knee_flexion_deg"], abs=2.5)


def paths_of(folder: Path) -> list[Path]:
    return [folder / name for name in ("ik.mot", "grf.mot", "id.sto")]


def test_a_file_cut_in_two_trials_pools_the_strides_and_has_deviations(tmp_path: Path) -> None:
    one, two = tmp_path / "one", tmp_path / "two"
    one.mkdir()
    two.mkdir()
    again = opensim(two)
    with pytest.raises(InputError, match="its strides would count twice"):
        reference_import.import_reference(opensim(one) + again, ImportOptions(mass=MASS))
    edited(paths_of(one)[2], lambda label, s: 0.9 * s if "moment" in label else s)
    edited(again[2], lambda label, s: 1.1 * s if "moment" in label else s)
    for path in again:
        edited(path, lambda label, s: s + (0.02 if label == "time" else 0.001))
    found = reference_import.import_reference(paths_of(one) + again, ImportOptions(mass=MASS))
    assert len(found.strides["right"]) == 6
    # three strides 10 % below the mean and three above it
    peak = found.table["ankle_plantarflexor_moment_nm_per_kg"][48]
    assert found.table["ankle_moment_sd_nm_per_kg"][48] == pytest.approx(0.1 * peak * np.sqrt(6 / 5), rel=2e-3)
    assert set(reference.DEVIATION_COLUMNS) <= set(found.table)
    short = reference_import.import_reference(
        made.opensim(tmp_path, Walker(seconds=2.6)), ImportOptions(mass=MASS, side="right")
    )
    assert len(short.strides["right"]) == 2
    assert not set(reference.DEVIATION_COLUMNS) & set(short.table)
    assert said(short, "missing", "3 or more are needed")


def test_plates_go_to_the_leg_whose_knee_is_straight(tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    swapped = storage.read(paths[1])
    columns = {
        label.replace("_1_", "_x_").replace("_2_", "_1_").replace("_x_", "_2_"): s
        for label, s in swapped.columns.items()
    }
    storage.write(Storage(columns, False), paths[1])
    right = limbs(paths, RAW)["right"]
    assert np.interp(0.43, right.time, right.channels["grf_vertical"]) == pytest.approx(70 * 7.7176, abs=1.0)


def without(file: int, part: str) -> Callable[[list[Path]], list[Path]]:
    def leave_out(paths: list[Path]) -> list[Path]:
        edited(paths[file], lambda label, s: None if part in label else s)
        return paths

    return leave_out


def emptied(file: int, part: str) -> Callable[[list[Path]], list[Path]]:
    def empty(paths: list[Path]) -> list[Path]:
        edited(paths[file], lambda label, s: np.full(len(s), np.nan) if part in label else s)
        return paths

    return empty


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda paths: paths[:2], "no ankle moment of the right leg, and none can be derived"),
        (lambda paths: [paths[0], paths[2]], "no ground reaction of the right foot"),
        (lambda paths: paths[1:], "neither knee and ankle angles of one leg nor markers"),
        (without(0, "hip"), "so nothing says how the leg leans"),
        (without(0, "ankle"), "neither knee and ankle angles of one leg nor markers"),
        (without(1, "vz"), "has not all three components"),
        (emptied(1, "1_vy"), "column 'ground_force_1_vy' holds no number"),
        (emptied(0, "ankle"), "neither knee and ankle angles of one leg nor markers"),
        (emptied(2, "ankle"), "no ankle moment of the right leg"),
    ],
)
def test_what_is_missing_is_one_sentence(spoil: Callable[[list[Path]], list[Path]], says: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        reference_import.import_reference(spoil(opensim(tmp_path)), ImportOptions(mass=MASS))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_markers_that_are_missing_are_named(tmp_path: Path) -> None:
    paths = markers(tmp_path)
    old = trc.read(paths[0])
    trc.write(trc.Markers(old.time, {n: p for n, p in old.positions.items() if "KNEE" not in n}), paths[0])
    with pytest.raises(
        InputError, match=r"no markers for knee; name them in a file for --map, under \[markers.right\]"
    ):
        reference_import.import_reference(paths, RAW)
    trc.write(trc.Markers(old.time, {n.replace("KNEE", "GENU"): p for n, p in old.positions.items()}), paths[0])
    (tmp_path / "map.toml").write_text('[markers.right]\nknee = ["R_GENU"]\n[markers.left]\nknee = ["L_GENU"]\n')
    found = reference_import.import_reference(paths, replace(RAW, mapping=mapping.read(tmp_path / "map.toml")))
    assert found.table["knee_flexion_deg"][30] == pytest.approx(8.84, abs=0.5)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[right", "is not valid TOML"),
        ("[middle]", "unknown key 'middle'; allowed: right, left"),
        ('[right]\nelbow = "x"', "unknown key 'elbow'"),
        ("[right]\nknee_angle = 3", "must be a column's name, or a table with 'column'"),
        ('[right]\nknee_angle = { column = "x", sign = 2 }', "sign = 2; allowed: 1 and -1"),
        ('[right]\nknee_angle = { column = "x", zero = nan }', "zero = nan"),
        ('[right]\nknee_angle = "nowhere"', "there is no column 'nowhere'"),
        ('[right]\nknee_angle = { column = "knee_angle_r", unit = "kg" }', "which is no unit of knee_angle"),
        ('[markers.right]\nknee = "x"', "must be a list"),
        ('[axes]\nforward = "x"', "needs 'forward' and 'up'"),
        ('[axes]\nforward = "x"\nup = "-x"', "two different axes"),
        ('[axes]\nforward = "w"\nup = "y"', "allowed: x, y, z"),
    ],
)
def test_bad_maps_are_one_sentence(text: str, says: str, tmp_path: Path) -> None:
    (tmp_path / "map.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        reference_import.import_reference(opensim(tmp_path), replace(RAW, mapping=mapping.read(tmp_path / "map.toml")))
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_numbers_that_are_no_measurement_are_refused(tmp_path: Path) -> None:
    paths = markers(tmp_path)
    force = paths[1]
    edited(force, lambda label, s: s * 1e300 if label.endswith("1_vx") else s)
    with pytest.raises(InputError, match="column 'ground_force_1_vx' holds"):
        reference_import.import_reference(paths, RAW)
    opensim(tmp_path)
    old = trc.read(paths[0])
    far = {name: place * (1e6 if "R_TOE" in name else 1.0) for name, place in old.positions.items()}
    trc.write(trc.Markers(old.time, far), paths[0])
    with pytest.raises(InputError, match=r"marker 'R_TOE' is .* m away: a wrong unit\?"):
        reference_import.import_reference(paths, RAW)


def test_names_that_would_steer_a_terminal_are_refused(tmp_path: Path) -> None:
    path = made.treadmill(tmp_path, Walker())
    path.write_text(path.read_text().replace("LeftCOP_x", "Left\x1b[2JCOP_x", 1))
    with pytest.raises(InputError, match="characters that cannot be shown") as caught:
        reference_import.import_reference([path], RAW)
    assert str(caught.value).isprintable()


def test_options_that_mean_nothing_are_refused() -> None:
    for wrong in ({"mass": 3.0}, {"stature": 17.5}, {"cutoff": -1.0}, {"threshold": 0.0}, {"mass": float("nan")}):
        with pytest.raises(InputError, match="allowed"):
            ImportOptions(**wrong)  # type: ignore[arg-type]


def test_a_laboratory_with_other_axes(tmp_path: Path) -> None:
    turn = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    turn[0] *= np.linalg.det(turn)
    paths = markers(tmp_path)
    force = storage.read(paths[1])
    for plate in "12":
        for kind in "vp":
            old = np.stack([force.columns[f"ground_force_{plate}_{kind}{a}"] for a in "xyz"], axis=1) @ turn.T
            for number, axis in enumerate("xyz"):
                force.columns[f"ground_force_{plate}_{kind}{axis}"] = old[:, number]  # type: ignore[index]
    storage.write(force, paths[1])
    trc.write(made.markers(Walker(), turn), paths[0])
    found = reference_import.import_reference(paths, ImportOptions(mass=MASS))
    assert any("forward is -y" in e["why"] and "up is +z" in e["why"] for e in found.log.channels)
    for column in ("shank_forward_deg", "ankle_plantarflexor_moment_nm_per_kg", "grf_forward_n_per_kg"):
        assert np.abs(found.table[column] - HUMAN(column, found.table[reference.PHASE_COLUMN] / 100)).max() < 1.0, (
            column
        )


@pytest.mark.parametrize(("late", "strides"), [(0.0, 3), (0.02, 6)])
def test_one_walk_in_two_forms_counts_once(late: float, strides: int, tmp_path: Path) -> None:
    paths = opensim(tmp_path)
    (tmp_path / "again").mkdir()
    again = opensim(tmp_path / "again")
    for path in again:
        edited(path, lambda label, s: s + late if label == "time" else s + 1e-6)
    found = reference_import.import_reference([*paths, *again], RAW)
    assert len(found.strides["right"]) == strides
    assert bool(said(found, "suspicious", "the same walk in another form")) == (late == 0.0)


def test_plates_of_a_c3d_have_its_markers_axes_beside_angles_of_another_file(tmp_path: Path) -> None:
    (c3d,) = captured(tmp_path)
    angles, _, moments = opensim(tmp_path)
    found = reference_import.import_reference([c3d, angles, moments], ImportOptions(mass=MASS))
    assert any(e["file"] == "ik.mot" and e["channel"] == "knee_angle" for e in found.log.channels)
    off = found.table["grf_forward_n_per_kg"] - HUMAN("grf_forward_n_per_kg", found.table[reference.PHASE_COLUMN] / 100)
    assert np.abs(off).max() < 0.3
    alone = reference_import.import_reference(
        [c3d, angles], ImportOptions(mass=MASS)
    )  # nobody's moment but the markers'
    assert said(alone, "derived", "the angles in ik.mot come without a moment and were left out")
    by_markers = reference_import.import_reference([c3d], ImportOptions(mass=MASS))
    assert alone.table["ankle_dorsiflexion_deg"] == pytest.approx(by_markers.table["ankle_dorsiflexion_deg"])


def test_why_one_leg_has_no_whole_stride_and_that_the_other_has(tmp_path: Path) -> None:
    paths = made.opensim(tmp_path, Walker(seconds=1.75))
    edited(paths[1], lambda label, s: s + 9.0 if label.endswith("1_vy") else s)
    with pytest.raises(InputError) as caught:
        reference_import.import_reference(paths, ImportOptions(mass=MASS, side="left"))
    assert (
        "1 stride of the left leg not whole and left out: the heel strike after that at 0.65 s is on no plate"
        in str(caught.value)
    )
    assert "with nobody on it" not in str(caught.value)  # which is the right one's, and no reason
    assert str(caught.value).endswith("; the right leg has one: --side right")
