"""The walks of the hidden-effect benchmark: what hides in them is what the package would name."""

import json
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks" / "hidden_effects"))

import walks

from klute_sim.dataset import dataset as datasets
from klute_sim.device.files import load
from klute_sim.effects import catalogue
from klute_sim.rigs.gait.body import read
from klute_sim.rigs.gait.build import build
from klute_sim.rigs.replay.foot import foot_of


def test_every_hidden_effect_is_in_the_catalogue_with_these_numbers() -> None:
    for hidden in walks.CATALOGUE:
        effect, form = catalogue.form_of(hidden.name, hidden.form)
        assert set(hidden.typical) == {p.key for p in form.parameters}
        assert (effect.kind == "body") == (hidden.edit is not None)
        assert (effect.kind == "instrument") == (hidden.channel is not None)
        for p in form.parameters:
            neutral, typical = hidden.typical[p.key]
            assert neutral == (typical if p.neutral is None else p.neutral)
            assert p.low <= neutral + walks.SIZES[1] * (typical - neutral) <= p.high


@pytest.mark.parametrize("hidden", [h for h in walks.CATALOGUE if h.edit], ids=lambda h: f"{h.name}-{h.form}")
def test_the_benchmarks_own_mjcf_means_the_same(hidden: walks.Hidden) -> None:
    device = load(walks.DEVICE)
    own = {key: typical for key, (_, typical) in hidden.typical.items()}

    def edit(spec: mujoco.MjSpec) -> None:
        assert hidden.edit is not None
        hidden.edit(spec, own)

    model = build(device, mass=75.0, stature=1.75, step=walks.STEP, edit=edit)
    foot, wanted = read(model), catalogue.edited({(hidden.name, hidden.form): own}, foot_of(device))
    if hidden.name == "end_stop":
        (bumper,) = (k for k in range(model.ntendon) if model.tendon(k).name == "rubber")
        assert model.tendon_stiffness[bumper] == pytest.approx(wanted.bumper)
        assert model.tendon_lengthspring[bumper, 1] == pytest.approx(wanted.bumper_at)
    else:
        assert foot == pytest.approx(wanted, rel=1e-9)
        assert foot != pytest.approx(foot_of(device), rel=1e-3)


def test_a_plan_is_the_same_again_and_begins_with_the_shorter_one() -> None:
    assert walks.plan(5, 2, 7) == walks.plan(5, 2, 7)
    assert walks.plan(3, 0, 7) == walks.plan(5, 2, 7)[:3]
    assert [one["hidden"] for one in walks.plan(0, 2, 7)] == [[], []]
    names = {one["hidden"][0]["name"] for one in walks.plan(40, 0, 7)}
    assert names == {hidden.name for hidden in walks.CATALOGUE}


def test_a_dataset_is_read_and_its_truth_lies_beside_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(walks, "GROUPS", {"fit_1": 1.2})
    monkeypatch.setattr(walks, "STRIDES", 2)
    fault = {"name": "sensor_offset", "form": "linear", "parameters": {"offset": 2.0}, "channel": "ankle_angle"}
    for name, hidden in (("plain", []), ("faulty", [fault])):
        walks.make(tmp_path / name, tmp_path / f"{name}.truth.json", [1, 2], hidden)
    plain, faulty = (datasets.read(tmp_path / name) for name in ("plain", "faulty"))
    assert plain.rig == "gait"
    assert [trial.group for trial in plain.trials] == ["fit_1", "fit_1"]
    one, other = (each.trials[0].measured["ankle_angle"].value for each in (plain, faulty))
    assert other - one == pytest.approx(np.radians(2.0), abs=1e-6)
    assert len({len(trial.prescribed["cop_x"].time) for trial in plain.trials}) == 2  # repeats differ in pace
    assert json.loads((tmp_path / "faulty.truth.json").read_text("utf-8"))["instruments"] == [fault]
    assert not list((tmp_path / "faulty").glob("*truth*"))


def test_lags_are_those_of_the_catalogue() -> None:
    time = walks.STEP * np.arange(4000)
    values = np.sin(9.0 * time)
    fault = {"name": "sensor_lag", "parameters": {"time_constant_s": 0.02}}
    wanted = catalogue.effects()["sensor_lag"].forms[0].laws["reading"]((0.02,), time, values)
    assert walks.distorted(values, fault) == pytest.approx(wanted, abs=3e-3)
