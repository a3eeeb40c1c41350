"""``klute-sim assess`` end to end, and the criteria of an assessment."""

import html
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import klute_sim as ks
from klute_sim.baselines.assessment import CRITERIA, MIN_TOE_CLEARANCE_MM, assess_quantities, collect_shortfalls
from klute_sim.gait.metrics import GaitMetrics, compute_reference_metrics
from klute_sim.report.assessment.figure import MAX_CURVES, build_figure
from tests.command_line import run
from tests.gait.reference_files import write_reference_folder

QUICK = ("--strides", "1", "--step", "1")


@pytest.fixture(scope="module")
def assessed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], str]:
    folder = tmp_path_factory.mktemp("assess")
    write_reference_folder(folder / "anna", mass=58.0, stature=1.62)
    write_reference_folder(folder / "ben <b>", mass=81.0, stature=1.84, load_ratio=1.2)
    arguments = ("anna", "ben <b>", "--only", "spring-foot-6", "--controller", "profile", *QUICK, "--out", "page")
    done = run("assess", *arguments, "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder / "page", json.loads(done.stdout), (folder / "page" / "index.html").read_text("utf-8")


def test_each_person_has_every_controller_beside_the_own_ankle(
    assessed: tuple[Path, dict[str, Any], str],
) -> None:
    folder, content, _ = assessed
    assert (
        {file.name for file in folder.iterdir()}
        == set(content["files"])
        == {
            *("index.html", "assessment.json", "person-1.png", "person-2.png"),
        }
    )
    assert json.loads((folder / "assessment.json").read_text()) == content
    assert [person["reference"] for person in content["persons"]] == ["anna", "ben <b>"]
    for person, mass, ratio in zip(content["persons"], (58.0, 81.0), (1.0, 1.2), strict=True):
        assert person["subject"]["mass_kg"] == mass
        names = [controller["name"] for controller in person["controllers"]]
        assert names == ["spring-foot-6", "klute-1-1-4-pair, profile"]
        for controller in person["controllers"]:
            quantities = {quantity["name"]: quantity for quantity in controller["quantities"]}
            assert quantities["peak ankle power"]["own"] == pytest.approx(ratio * 3.29, abs=0.05)
            sentences = [quantity["shortfall"] for quantity in controller["quantities"] if quantity["shortfall"]]
            assert controller["shortfalls"][-len(sentences) :] == sentences
        foot = person["controllers"][0]
        assert foot["strides_per_tank"] is None
        assert any("net ankle work of a stride" in sentence for sentence in foot["shortfalls"])
        assert person["fewest_shortfalls"] == "klute-1-1-4-pair, profile"
        assert [controller["shipped"] for controller in person["controllers"]] == [True, False]


def test_page_is_self_contained_and_escapes_names(assessed: tuple[Path, dict[str, Any], str]) -> None:
    _, content, page = assessed
    assert page.count("data:image/png;base64,") == 2
    assert "://" not in re.sub(r"data:image/png;base64,[^\"]+", "", page)
    assert "ben &lt;b&gt;" in page
    assert "ben <b>" not in page
    assert "shipped: spring-foot-6" in page
    assert "shipped: klute-1-1-4-pair" not in page
    for person in content["persons"]:
        for controller in person["controllers"]:
            for sentence in controller["shortfalls"]:
                assert sentence in html.unescape(page)


def test_terminal_shows_verdict_and_shortfalls_of_the_closest(tmp_path: Path) -> None:
    done = run("assess", "--only", "spring-foot-3", *QUICK, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert ": not served; fewest shortfalls (" in done.stdout
    assert "): spring-foot-3" in done.stdout
    assert "of the person's own ankle" in done.stdout
    assert "own ankle" in done.stdout
    assert (tmp_path / "runs" / "assess-001" / "index.html").is_file()


def test_figure_has_every_controller_of_the_user_by_a_thick_line() -> None:
    run = ks.simulate_gait(strides=1, time_step=1e-3).recording
    shipped = {f"shipped: {number}": run for number in range(8)}
    (panel, *_) = build_figure({"mine": run}, shipped).axes
    widths = {line.get_label(): line.get_linewidth() for line in panel.get_lines()}
    assert list(widths) == ["own ankle", "mine", *list(shipped)[: MAX_CURVES - 1]]
    assert widths["mine"] > 1.5 * widths["shipped: 0"]


def test_own_ankle_with_enough_clearance_meets_every_criterion() -> None:
    recording = ks.simulate_gait(strides=1, time_step=1e-3)
    own_ankle = compute_reference_metrics(recording.recording)
    (stride,) = recording.gait_metrics.strides
    perfect = replace(
        stride,
        **own_ankle.__dict__,
        grf_vertical_tracking_rms_bw=0.0,
        toe_clearance_mm=MIN_TOE_CLEARANCE_MM,
        short_of_supply_pct=0.0,
        touches_in_swing=False,
    )
    metrics = GaitMetrics((perfect,))
    assert collect_shortfalls(metrics, assess_quantities(metrics, own_ankle)) == []
    poor = GaitMetrics((replace(perfect, touches_in_swing=True, toe_clearance_mm=1.0, ankle_power_peak_w_per_kg=1.0),))
    trip, power, toe = collect_shortfalls(poor, assess_quantities(poor, own_ankle))
    assert trip == "The foot touches the ground in swing: the person trips."
    assert power == "The peak ankle power is 1.00 W/kg, 30 % of the 3.29 W/kg of the person's own ankle."
    assert toe == "The toe clearance in mid-swing is 1.0 mm, less than 10 mm."
    high = GaitMetrics((replace(perfect, ankle_moment_peak_nm_per_kg=2.0),))
    (moment,) = collect_shortfalls(high, assess_quantities(high, own_ankle))
    assert "too much: 14" in moment
    assert len({criterion.describe() for criterion in CRITERIA}) == len(CRITERIA)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nobody"], "reference nobody cannot be read"),
        (["--mass", "7"], "mass is 7; allowed: 20 to 250 kg"),
        (["--only", "own"], "only 'own' is selected, but there is none"),
        (["--step", "7"], "step is 7; allowed: 0.01 to 1 ms"),
        (["--stride-time", "1"], "a stride time requires a reference file"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_file(arguments: list[str], message: str, tmp_path: Path) -> None:
    done = run("assess", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
