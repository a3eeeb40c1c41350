"""Accepted findings do not switch off other checks: these examine all trials without findings of their own."""

from collections.abc import Collection, Iterable, Sequence
from pathlib import Path

import numpy as np
import pytest

from klute_sim.datasets.dataset import load_dataset
from klute_sim.datasets.trial import Trial
from klute_sim.errors import InputError
from klute_sim.gait.replay import recording_mistakes
from klute_sim.plausibility.finding import Finding
from tests.datasets import test_mechanism_motion as joint
from tests.diagnosis.synthetic_gait_dataset import write_dataset
from tests.plausibility import test_bench_specimens as specimens

UPWARD = '"model.option.gravity_z" = 9.81\n'


def reverse_angle(folder: Path, names: Iterable[str]) -> None:
    """Reverse the motion in the trials of a joint."""
    for name in names:
        heading, *rows = (folder / f"{name}.csv").read_text().splitlines()
        cells = [row.split(",") for row in rows]
        reversed_rows = [",".join([*row[:3], str(66.0 - float(row[3])), *row[4:]]) for row in cells]
        (folder / f"{name}.csv").write_text("\n".join([heading, *reversed_rows]))


def test_reversed_angle_is_found_under_an_accepted_gravity(tmp_path: Path) -> None:
    joint.write(tmp_path, "ab", UPWARD)
    reverse_angle(tmp_path, "ab")
    with pytest.raises(InputError, match="accept it with --accept angle_joint-sign"):
        load_dataset(tmp_path, accept=["gravity"])
    names = {finding.name for finding in load_dataset(tmp_path, accept=["gravity", "angle_joint-sign"]).accepted}
    assert names == {"gravity", "angle_joint-sign"}


def test_reversed_angle_is_found_beside_an_accepted_trial(tmp_path: Path) -> None:
    joint.write(tmp_path, "abc")
    reverse_angle(tmp_path, "ab")
    path = tmp_path / "c.csv"
    path.write_text(path.read_text().replace("pressure_flexor [bar]", "pressure_flexor [MPa]"))
    accept = ["pressure_flexor-unit"]
    with pytest.raises(InputError, match=r"trial 'a': `angle_joint`.* more trial"):
        load_dataset(tmp_path, accept=accept)
    remarks = load_dataset(tmp_path, accept=[*accept, "angle_joint-sign"]).remarks
    assert "further checks left out trial 'c', because findings there are accepted" in remarks


def test_geometry_is_judged_beside_an_accepted_trial(tmp_path: Path) -> None:
    def add_code(filling: specimens.Filling) -> specimens.Filling:
        is_coded = np.arange(len(filling.force)) % 100 == 50
        return filling._replace(force=np.where(is_coded, -9999.0, filling.force))

    change = specimens.change_where(lambda f: (f.ratio, f.repeat) == (1.0, 1), add_code)
    folder = specimens.write_fillings(tmp_path, change, strength=dict.fromkeys(specimens.WEAKNESS, 2.8))
    pattern = r"trial '100_2': .* times in the 7 trials.* accept it with --accept force-geometry"
    with pytest.raises(InputError, match=pattern):
        load_dataset(folder, accept=["force-missing"])


@pytest.fixture(scope="module")
def walks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a dataset of two walks, of which the second has a force in a wrong unit."""
    folder = write_dataset(tmp_path_factory.mktemp("walks") / "d", groups=("fit_1",), repeats=2, strides=3)
    second = folder / "fit_1_1_load.csv"
    second.write_text(second.read_text().replace("force [N]", "force [kN]"))
    return folder


def find_delays(trials: Sequence[Trial], accepted: Collection[str]) -> list[Finding]:
    return [Finding("plate-delay", f"trial '{trial.name}'", "late") for trial in trials]


@pytest.mark.slow
def test_walks_without_findings_are_examined_beside_an_accepted_one(walks: Path) -> None:
    with pytest.raises(
        InputError, match=r"fit_1_0.*': late\. If this is no mistake, accept it with --accept plate-delay"
    ):
        load_dataset(walks, accept=["force-unit"], find_in_walks=find_delays)
    dataset = load_dataset(walks, accept=["force-unit", "plate-delay"], find_in_walks=find_delays)
    assert [finding.name for finding in dataset.accepted] == ["force-unit", "plate-delay"]


@pytest.mark.slow
def test_name_of_a_check_that_left_trials_out_is_not_called_unused(walks: Path) -> None:
    file = walks / "dataset.toml"
    text = file.read_text("utf-8")
    file.write_text('accept = ["force-unit", "plate-delay"]\n' + text, "utf-8")
    *_, scope, unused = load_dataset(walks).remarks
    file.write_text(text, "utf-8")
    assert scope.startswith("further checks left out trial 'fit_1_1")
    assert unused == f"{file}: 'accept' names 'plate-delay', which was not found in trials without accepted findings"


def test_late_plate_is_found_under_accepted_absolute_pressures(monkeypatch: pytest.MonkeyPatch) -> None:
    absolute, late = Finding("pressure-absolute", "trial 'a'", "absolute"), Finding("plate-delay", "trial 'a'", "late")
    monkeypatch.setattr(recording_mistakes, "find_absolute_pressures", lambda trials: [absolute])
    monkeypatch.setattr(recording_mistakes, "find_clock_delays", lambda trials: [late])
    assert recording_mistakes.find_recording_mistakes([]) == [absolute]
    assert recording_mistakes.find_recording_mistakes([], ["pressure-absolute"]) == [absolute, late]
