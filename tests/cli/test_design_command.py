"""Tests of ``klute-sim design`` from the command line to the files."""

import csv
import io
import json
from importlib import resources
from pathlib import Path

import pytest

from klute_sim.device.device import load_device
from klute_sim.sizing.parts.actuator import MIN_TESTED_SLENDERNESS
from tests.command_line import run
from tests.gait.reference_files import write_reference, write_reference_folder

REFERENCE_PEAK = 1.43
"""Peak ankle moment of the reference [N m/kg]."""


@pytest.fixture(scope="module")
def walker(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    folder = tmp_path_factory.mktemp("walker")
    completed = run("design", "--mass", "75", "--json", cwd=folder)
    assert completed.returncode == 0, completed.stderr
    return folder, json.loads(completed.stdout)


def test_folder_holds_printed_summary(walker: tuple[Path, dict[str, object]]) -> None:
    folder, summary = walker
    run_folder = folder / "runs" / "design-001"
    assert summary["run"] == str(run_folder.relative_to(folder))
    assert {f.name for f in run_folder.iterdir()} == {
        "device.toml", "summary.json", "figure.png", "index.html", "profile.csv"
    } == set(summary["files"])  # type: ignore[call-overload]  # fmt: skip
    assert json.loads((run_folder / "summary.json").read_text()) == summary
    assert (run_folder / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert load_device(run_folder / "device.toml").spec.collect_assumptions() == summary["assumptions"]
    demand = summary["demand"]
    assert 1.0 < demand["air_g"] < 2.0  # type: ignore[index]
    assert 4.0 < demand["max_required_pressure_bar"] < 5.0  # type: ignore[index]
    assert demand["max_shortening_velocity_mm_per_s"] > 0.0  # type: ignore[index]


def test_designed_device_can_be_shown(walker: tuple[Path, dict[str, object]]) -> None:
    folder, _ = walker
    completed = run("device", "runs/design-001/device.toml", "--json", cwd=folder)
    assert completed.returncode == 0, completed.stderr
    rows = json.loads(completed.stdout)["numbers"]
    assert all(row["source"] for row in rows)


TRANSFERRED_PROFILE = pytest.param(
    ("--controller", "runs/design-001/profile.csv"), marks=pytest.mark.long, id="carried over"
)


@pytest.mark.slow
@pytest.mark.parametrize("profile", [pytest.param((), id="tuned"), TRANSFERRED_PROFILE])
def test_designed_prosthesis_completes_gait_run(
    walker: tuple[Path, dict[str, object]], profile: tuple[str, ...]
) -> None:
    """About 15 s each: three strides on the gait rig."""
    folder, _ = walker
    device = ("--device", "runs/design-001/device.toml")
    completed = run("gait", *device, "--mass", "75", "--strides", "3", "--json", *profile, cwd=folder)
    assert completed.returncode == 0, completed.stderr
    metrics = json.loads(completed.stdout)
    assert metrics["ankle_moment_peak_nm_per_kg"] >= 0.9 * REFERENCE_PEAK
    assert not metrics["touches_in_swing"]


@pytest.mark.slow
def test_imported_subject_determines_mass_and_demand(tmp_path: Path) -> None:
    write_reference_folder(tmp_path / "me", mass=62.0, stature=1.66, load_ratio=1.1)
    completed = run("design", "--reference", "me", "--speed", "1.5", "--json", "--out", "o", cwd=tmp_path)
    assert completed.returncode == 0, completed.stderr
    summary = json.loads(completed.stdout)
    assert summary["target"]["mass_kg"] == 62.0
    assert summary["target"]["peak_moment_nm"] == pytest.approx(62.0 * 1.1 * REFERENCE_PEAK, rel=0.01)
    assert summary["subject"]["stature_m"] == 1.66
    assert any("at 1.5 m/s, the ankle moment" in remark for remark in summary["remarks"])
    assert summary["gait"].endswith("--reference me --speed 1.5")
    slower = run("design", "--reference", "me", "--speed", "0.8", "--json", "--out", "p", cwd=tmp_path)
    velocities = [s["demand"]["max_shortening_velocity_mm_per_s"] for s in (summary, json.loads(slower.stdout))]
    assert velocities[0] > 1.5 * velocities[1]


def test_reference_without_a_body_mass_requires_one(tmp_path: Path) -> None:
    write_reference(tmp_path / "bare.csv")
    completed = run("design", "--reference", "bare.csv", cwd=tmp_path)
    assert completed.returncode == 2
    assert completed.stderr == "klute-sim: reference bare.csv states no body mass: give mass\n"


def test_tables_report_selection_violations_and_assumptions(tmp_path: Path) -> None:
    completed = run(
        "design", "--actuator", "klute-3-4", "--count", "2", "--resting-length", "250", "--eccentric-force", "400",
        "--bore", "20", "--out", "pair", cwd=tmp_path,
    )  # fmt: skip
    assert completed.returncode == 0, completed.stderr
    texts = ("1.062", "3/4 in (selected)", "not met", "numbers are assumed", "cavitation number", "Design folder")
    for expected in texts:
        assert expected in completed.stdout
    spec = load_device(tmp_path / "pair" / "device.toml").spec
    assert spec.damper is not None
    assert spec.damper.orifice_concentric_mm == pytest.approx(1.084, rel=0.005)
    assert spec.damper.orifice_eccentric_mm == pytest.approx(1.062, rel=0.005)
    assert not (tmp_path / "pair" / "profile.csv").exists()
    assert "No pressure profile was written, because a muscle has no stride" in completed.stdout
    assert "bore, given" in completed.stdout
    assert "bore (4.2)" not in completed.stdout
    assert "cannot be built" not in completed.stdout
    assert "Target: muscle 'generic'" in completed.stdout


@pytest.mark.slow
def test_excess_cylinder_pressure_is_reported(tmp_path: Path) -> None:
    completed = run("design", "--mass", "75", "--bore", "1", "--json", "--out", "o", cwd=tmp_path)
    summary = json.loads(completed.stdout)
    (remark,) = [remark for remark in summary["remarks"] if "cylinder pressure is" in remark]
    assert f"cylinder pressure is {summary['damper']['pressure_mpa']:.4g} MPa, but 4.7 MPa are allowed" in remark
    assert "bore of 27.0" in remark
    assert json.loads((tmp_path / "o" / "summary.json").read_text()) == summary
    assert "klute-sim gait --device o/device.toml --controller o/profile.csv --mass 75" in " ".join(summary["remarks"])


@pytest.mark.slow
def test_strength_has_one_verdict(walker: tuple[Path, dict[str, object]], tmp_path: Path) -> None:
    remarks = " ".join(walker[1]["remarks"])  # type: ignore[call-overload]
    assert "strong enough" in remarks
    assert "too weak" not in remarks
    summary = json.loads(run("design", "--mass", "250", "--pressure", "2", "--json", cwd=tmp_path).stdout)
    assert summary["force_ratio"] >= 1.0 > summary["demand"]["min_force_margin"]
    remark = " ".join(summary["remarks"])
    assert "The actuators are too weak: statically they have" in remark
    assert "enough" not in remark


def test_options_determine_design(tmp_path: Path) -> None:
    completed = run(
        "design", "--muscle", "bobbert_1986", "--l0", "100", "--vmax", "500", "--a", "0.3", "--b", "0.35",
        "--saturation", "1.4", "--pressure", "4", "--cylinder-pressure", "10", "--eccentric-speed", "200",
        "--name", "mine", "--json", "--out", "o", cwd=tmp_path,
    )  # fmt: skip
    assert completed.returncode == 0, completed.stderr
    summary = json.loads(completed.stdout)
    target = summary["target"]
    assert (target["a_over_f0"], target["b_over_vmax"], target["saturation"]) == (0.3, 0.35, 1.4)
    assert (target["vmax_mm_per_s"], target["vmax_assumed"]) == (500.0, False)
    assert summary["device"] == "mine"
    assert summary["required_force_n"] == 3000.0
    assert summary["supply_pressure_bar"] == 4.0
    assert summary["resting_length_mm"] == 100.0
    assert summary["slenderness"] < MIN_TESTED_SLENDERNESS
    assert summary["damper"]["concentric"]["pressure_mpa"] == pytest.approx(10.0, rel=0.01)
    assert summary["damper"]["eccentric"]["speed_mm_per_s"] == pytest.approx(200.0)
    assert summary["demand"] is None


@pytest.mark.slow
def test_moment_arm_and_tendon_strain_determine_design(tmp_path: Path) -> None:
    options = ("--mass", "75", "--moment-arm", "40", "--tendon-strain", "3", "--json")
    summary = json.loads(run("design", *options, cwd=tmp_path).stdout)
    assert summary["demand"]["tendon_peak_n"] == pytest.approx(summary["target"]["peak_moment_nm"] / 0.040, rel=1e-3)
    assert "stretched 3 %" in summary["assumptions"]["tendon.stiffness_1_n_per_mm"]
    assert summary["fixed_fields"] == ["moment_arm", "tendon_strain"]


@pytest.mark.slow
def test_specified_values_are_not_assumptions(tmp_path: Path) -> None:
    options = ("--mass", "75", "--moment-arm", "48", "--cylinder-pressure", "10", "--a", "0.28", "--json", "--out", "o")
    summary = json.loads(run("design", *options, cwd=tmp_path).stdout)
    varied = {row["assumption"] for row in summary["sensitivity"]["rows"]}
    assert varied.isdisjoint({"moment arm", "cylinder pressure", "a/F0 = b/Vmax", "a/F0"})
    assert "b/Vmax" in varied
    assert "damper.bore_mm" not in summary["assumptions"]
    assert (
        load_device(tmp_path / "o" / "device.toml").spec.sources["damper.bore_mm"].endswith("given to klute-sim design")
    )
    assert summary["sensitivity"]["nominal"]["cylinder_pressure_mpa"] == pytest.approx(10.0, rel=0.01)
    assert set(summary["sensitivity"]["excluded_assumptions"]) == {"pressure_rate"}


def test_reference_without_moment_is_refused(tmp_path: Path) -> None:
    file = resources.files("klute_sim.gait") / "normative_gait.csv"
    heading, *rows = csv.reader(io.StringIO(file.read_text("utf-8")))
    column = heading.index("ankle_plantarflexor_moment_nm_per_kg")
    with (tmp_path / "limp.csv").open("w", newline="") as out:
        csv.writer(out).writerows([heading, *([*row[:column], "0", *row[column + 1 :]] for row in rows)])
    completed = run("design", "--mass", "75", "--reference", "limp.csv", cwd=tmp_path)
    assert completed.returncode == 2
    assert completed.stderr.count("\n") == 1
    message = "reference limp.csv: `ankle_plantarflexor_moment_nm_per_kg` peaks at 0, which is not plausible in N·m/kg"
    assert message in completed.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "no target: give mass, reference, muscle or isometric_force"),
        (["--mass", "nan"], "mass is nan; allowed: 20 to 250 kg"),
        (["--mass", "75", "--f0", "100"], "isometric_force and mass exclude each other"),
        (["--mass", "75", "--muscle", "cat"], "muscle and mass exclude each other"),
        (["--f0", "100", "--reference", "x.csv"], "isometric_force and reference exclude each other"),
        (["--f0", "100", "--stature", "1.8"], "stature requires mass or reference"),
        (["--muscle", "bobbert_1986", "--moment-arm", "40"], "moment_arm requires mass or reference"),
        (["--mass", "75", "--reference", "x.csv"], "reference x.csv cannot be read"),
        (["--muscle", "dog"], "Table 2.4 has no muscle 'dog'"),
        (["--mass", "75", "--actuator", "big"], "unknown actuator 'big'; allowed: klute-1-1-4"),
        (["--mass", "75", "--resting-length", "400"], "but the shank has only"),
        (["--f0", "-3"], "F0 is -3; allowed: 0.01 to 100000 N"),
        (["--f0", "lots"], "'lots' is not a number; write the number alone, in N"),
        (["--mass", "75", "--name", ""], "name is empty"),
        (["--f0", "9", "--bore", "1", "--eccentric-force", "1e5", "--eccentric-speed", "1"], "bore / 1000 to bore"),
    ],
)
def test_invalid_input_raises_one_sentence_and_writes_nothing(
    arguments: list[str], message: str, tmp_path: Path
) -> None:
    completed = run("design", *arguments, cwd=tmp_path)
    assert completed.returncode == 2
    assert message in completed.stderr
    assert completed.stderr.count("\n") == 1
    assert "Traceback" not in completed.stderr
    assert not list(tmp_path.iterdir())


def test_help_has_units_and_examples(tmp_path: Path) -> None:
    help_text = run("design", "--help", cwd=tmp_path).stdout
    assert "bobbert_1986, bobbert_van_ingen_schenau_1990" in " ".join(help_text.split())
    for expected in ("[MPa]", "[mm/s]", "Examples:", "klute-sim design --mass 75", "assumed"):
        assert expected in help_text
