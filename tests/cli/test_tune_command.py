"""``klute-sim tune`` from end to end: few walks, short ones."""

import json
from pathlib import Path

import pytest

from klute_sim.controllers.pressure import load_profile
from klute_sim.device.device import load_device
from tests.command_line import run

pytest.importorskip("cma")


def test_a_few_walks_make_it_better_and_more_of_them_go_on(tmp_path: Path) -> None:
    done = run("tune", "--budget", "14", "--also", "tendon.stiffness_1_n_per_mm", "--out", "t", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["cost"]["tuned"] < found["cost"]["before"]
    assert found["walks"] >= 14
    assert found["files"] == ["device.toml", "tried.csv", "tuned.csv", "tuning.json", "tuning.png"]
    assert {each.name for each in (tmp_path / "t").iterdir()} == {*found["files"], "tune.json", "walks"}
    knobs = found["knobs"]
    pressures = [knob["tuned"] for name, knob in knobs.items() if name.startswith("pressure at")]
    assert sorted(load_profile(tmp_path / "t" / "tuned.csv").pressure_bar) == pytest.approx(sorted(pressures), abs=1e-4)
    device = load_device(tmp_path / "t" / "device.toml")
    tuned = device.spec.collect_values()["tendon.stiffness_1_n_per_mm"]
    assert tuned == pytest.approx(knobs["tendon.stiffness_1_n_per_mm"]["tuned"], rel=1e-4)
    assert device.spec.sources["tendon.stiffness_1_n_per_mm"].startswith("assumed: found by klute-sim tune")
    rows = {row["name"]: row for row in found["table"]}
    for row in rows.values():
        assert row["before"] != row["tuned"]
    squares = [
        sum(rows[f"{each} to human, stance rms [sd]"][side] ** 2 for each in ("moment", "angle", "power"))
        for side in ("before", "tuned")
    ]
    assert squares[1] < squares[0]
    assert rows["peak net power [W/kg]"]["human"] == pytest.approx(3.29, abs=0.02)
    walks = len(list((tmp_path / "t" / "walks").iterdir()))
    again = run("tune", "--budget", "14", "--also", "tendon.stiffness_1_n_per_mm", "--out", "t", cwd=tmp_path)
    assert again.returncode == 0, again.stderr
    assert len(list((tmp_path / "t" / "walks").iterdir())) == walks
    assert "The objective fell by" in again.stdout
    assert "most plantarflexion [deg]" in again.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--weight", "air"], "--weight is 'air'; allowed: a part and a number, as in air=0.5"),
        (["--weight", "oil=1"], "there is no weight of 'oil'"),
        (["--also", "damper.colour"], "has no number 'damper.colour'"),
        (["--profile", "none.csv"], "pressure profile none.csv cannot be read"),
        (["--device", "nobody"], "no device 'nobody'"),
        (["--device", "klute-3-4"], "its file has no [tendon] section"),
        (
            ["--weight", "moment=0", "--weight", "angle=0", "--weight", "power=0", "--weight", "air=0"],
            "all weights are 0",
        ),
        (["--mass", "7"], "mass is 7; allowed: 20 to 250 kg"),
        (["--budget", "0"], "0"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(arguments: list[str], says: str, tmp_path: Path) -> None:
    done = run("tune", *arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert says in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())
