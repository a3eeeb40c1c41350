"""``klute-sim design`` end to end, as a user types it."""

import csv
import io
import json
from importlib import resources
from pathlib import Path

import pytest

from klute_sim.device.device import load_device
from klute_sim.sizing.parts.actuator import MIN_TESTED_SLENDERNESS
from tests.command_line import run

REFERENCE_PEAK = 1.43
"""Peak ankle moment of the reference [N m/kg]."""


@pytest.fixture(scope="module")
def walker(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, object]]:
    folder = tmp_path_factory.mktemp("walker")
    done = run("design", "--mass", "75", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder, json.loads(done.stdout)


def test_the_folder_holds_what_was_printed(walker: tuple[Path, dict[str, object]]) -> None:
    folder, shown = walker
    made = folder / "runs" / "design-001"
    assert shown["run"] == str(made.relative_to(folder))
    assert {f.name for f in made.iterdir()} == {
        "device.toml", "summary.json", "figure.png", "profile.csv"
    } == set(shown["files"])  # type: ignore[call-overload]  # fmt: skip
    assert json.loads((made / "summary.json").read_text()) == shown
    assert (made / "figure.png").read_bytes().startswith(b"\x89PNG")
    assert load_device(made / "device.toml").spec.collect_assumptions() == shown["assumptions"]
    demand = shown["demand"]
    assert 1.0 < demand["air_g"] < 2.0  # type: ignore[index]
    assert 4.0 < demand["needed_pressure_bar"] < 5.0  # type: ignore[index]
    assert demand["fastest_shortening_mm_per_s"] > 0.0  # type: ignore[index]


def test_the_device_can_be_shown(walker: tuple[Path, dict[str, object]]) -> None:
    folder, _ = walker
    done = run("device", "runs/design-001/device.toml", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)["numbers"]
    assert all(row["source"] for row in rows)


CARRIED_OVER = pytest.param(("--controller", "runs/design-001/profile.csv"), marks=pytest.mark.long, id="carried over")


@pytest.mark.parametrize("profile", [pytest.param((), id="tuned"), CARRIED_OVER])
def test_the_designed_prosthesis_walks(walker: tuple[Path, dict[str, object]], profile: tuple[str, ...]) -> None:
    """About 15 s each: three strides on the gait rig."""
    folder, _ = walker
    device = ("--device", "runs/design-001/device.toml")
    done = run("gait", *device, "--mass", "75", "--strides", "3", "--json", *profile, cwd=folder)
    assert done.returncode == 0, done.stderr
    walked = json.loads(done.stdout)
    assert walked["ankle_moment_peak_nm_per_kg"] >= 0.9 * REFERENCE_PEAK
    assert not walked["touches_in_swing"]


def test_the_tables_say_what_was_chosen_what_is_missed_and_what_is_assumed(tmp_path: Path) -> None:
    done = run(
        "design", "--actuator", "klute-3-4", "--count", "2", "--resting-length", "250", "--eccentric-force", "400",
        "--bore", "20", "--out", "pair", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    for expected in ("1.062", "3/4 in (taken)", "not met", "numbers are assumed", "cavitation number", "Design folder"):
        assert expected in done.stdout
    spec = load_device(tmp_path / "pair" / "device.toml").spec
    assert spec.damper is not None
    assert spec.damper.orifice_concentric_mm == pytest.approx(1.084, rel=0.005)
    assert spec.damper.orifice_eccentric_mm == pytest.approx(1.062, rel=0.005)
    assert not (tmp_path / "pair" / "profile.csv").exists()
    assert "No pressure profile was written, because a muscle has no stride" in done.stdout
    assert "bore, given" in done.stdout
    assert "bore (4.2)" not in done.stdout
    assert "more than the" not in done.stdout
    assert "Asked for: muscle 'generic'" in done.stdout


def test_a_cylinder_beyond_its_pressure_is_said(tmp_path: Path) -> None:
    done = run("design", "--mass", "75", "--bore", "1", "--json", "--out", "o", cwd=tmp_path)
    shown = json.loads(done.stdout)
    (said,) = [remark for remark in shown["remarks"] if "MPa in its cylinder" in remark]
    assert f"{shown['damper']['pressure_mpa']:.4g} MPa in its cylinder, more than the 4.7 MPa allowed" in said
    assert "bore of 27.0" in said
    assert json.loads((tmp_path / "o" / "summary.json").read_text()) == shown
    assert "klute-sim gait --device o/device.toml --controller o/profile.csv --mass 75" in " ".join(shown["remarks"])


def test_there_is_one_verdict_on_the_strength(walker: tuple[Path, dict[str, object]], tmp_path: Path) -> None:
    enough = " ".join(walker[1]["remarks"])  # type: ignore[call-overload]
    assert "strong enough" in enough
    assert "too weak" not in enough
    shown = json.loads(run("design", "--mass", "250", "--pressure", "2", "--json", cwd=tmp_path).stdout)
    assert shown["strength"] >= 1.0 > shown["demand"]["least_margin"]
    said = " ".join(shown["remarks"])
    assert "The actuators are too weak: at rest they have" in said
    assert "enough" not in said


def test_options_reach_the_design(tmp_path: Path) -> None:
    done = run(
        "design", "--muscle", "bobbert_1986", "--l0", "100", "--vmax", "500", "--a", "0.3", "--b", "0.35",
        "--saturation", "1.4", "--pressure", "4", "--cylinder-pressure", "10", "--eccentric-speed", "200",
        "--name", "mine", "--json", "--out", "o", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    shown = json.loads(done.stdout)
    target = shown["target"]
    assert (target["a_over_f0"], target["b_over_vmax"], target["saturation"]) == (0.3, 0.35, 1.4)
    assert (target["vmax_mm_per_s"], target["vmax_assumed"]) == (500.0, False)
    assert shown["device"] == "mine"
    assert shown["needed_force_n"] == 3000.0
    assert shown["supply_pressure_bar"] == 4.0
    assert shown["resting_length_mm"] == 100.0
    assert shown["slenderness"] < MIN_TESTED_SLENDERNESS
    assert shown["damper"]["concentric"]["pressure_mpa"] == pytest.approx(10.0, rel=0.01)
    assert shown["damper"]["eccentric"]["speed_mm_per_s"] == pytest.approx(200.0)
    assert shown["demand"] is None


def test_arm_and_strain_reach_the_design(tmp_path: Path) -> None:
    options = ("--mass", "75", "--moment-arm", "40", "--tendon-strain", "3", "--json")
    shown = json.loads(run("design", *options, cwd=tmp_path).stdout)
    assert shown["demand"]["tendon_peak_n"] == pytest.approx(shown["target"]["peak_moment_nm"] / 0.040, rel=1e-3)
    assert "stretched 3 %" in shown["assumptions"]["tendon.stiffness_1_n_per_mm"]
    assert shown["given"] == ["moment_arm", "tendon_strain"]


def test_what_is_given_is_no_assumption(tmp_path: Path) -> None:
    options = ("--mass", "75", "--moment-arm", "48", "--cylinder-pressure", "10", "--a", "0.28", "--json", "--out", "o")
    shown = json.loads(run("design", *options, cwd=tmp_path).stdout)
    varied = {row["assumption"] for row in shown["sensitivity"]["rows"]}
    assert varied.isdisjoint({"moment arm", "cylinder pressure", "a/F0 = b/Vmax", "a/F0"})
    assert "b/Vmax" in varied
    assert "damper.bore_mm" not in shown["assumptions"]
    assert (
        load_device(tmp_path / "o" / "device.toml").spec.sources["damper.bore_mm"].endswith("given to klute-sim design")
    )
    assert shown["sensitivity"]["base"]["cylinder_pressure_mpa"] == pytest.approx(10.0, rel=0.01)
    assert set(shown["sensitivity"]["left_out"]) == {"pressure_rate"}


def test_a_reference_that_asks_for_no_moment_is_refused(tmp_path: Path) -> None:
    file = resources.files("klute_sim.gait") / "normative_gait.csv"
    heading, *rows = csv.reader(io.StringIO(file.read_text("utf-8")))
    column = heading.index("ankle_plantarflexor_moment_nm_per_kg")
    with (tmp_path / "limp.csv").open("w", newline="") as out:
        csv.writer(out).writerows([heading, *([*row[:column], "0", *row[column + 1 :]] for row in rows)])
    done = run("design", "--mass", "75", "--reference", "limp.csv", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    says = "reference limp.csv: ankle_plantarflexor_moment_nm_per_kg peaks at 0; allowed: 0.1 to 10 N·m/kg"
    assert says in done.stderr
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "nothing to design for: give --mass KG"),
        (["--mass", "nan"], "mass is nan; allowed: 20 to 250 kg"),
        (["--mass", "75", "--f0", "100"], "--f0 does not go with --mass"),
        (["--mass", "75", "--muscle", "cat"], "--muscle does not go with --mass"),
        (["--f0", "100", "--reference", "x.csv"], "--reference goes with --mass"),
        (["--muscle", "bobbert_1986", "--moment-arm", "40"], "--moment-arm goes with --mass"),
        (["--mass", "75", "--reference", "x.csv"], "reference x.csv cannot be read"),
        (["--muscle", "dog"], "Table 2.4 has no muscle 'dog'"),
        (["--mass", "75", "--actuator", "big"], "there is no actuator 'big'; there are: klute-1-1-4"),
        (["--mass", "75", "--resting-length", "400"], "but the shank has room for"),
        (["--f0", "-3"], "F0 is -3; allowed: 0.01 to 100000 N"),
        (["--f0", "lots"], "'lots' is not a number; write the number alone, in N"),
        (["--mass", "75", "--name", ""], "--name is empty"),
        (["--f0", "9", "--bore", "1", "--eccentric-force", "1e5", "--eccentric-speed", "1"], "bore / 1000 to bore"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(arguments: list[str], says: str, tmp_path: Path) -> None:
    done = run("design", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())


def test_help_has_units_and_examples(tmp_path: Path) -> None:
    told = run("design", "--help", cwd=tmp_path).stdout
    assert "bobbert_1986, bobbert_van_ingen_schenau_1990" in " ".join(told.split())
    for expected in ("[MPa]", "[mm/s]", "Examples:", "klute-sim design --mass 75", "assumed"):
        assert expected in told
