"""Files of one trial in the draft of dataset.toml, and channels that only some files have."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

import klute_sim as ks
from tests.datasets.test_draft import COMMAND, DEVICE, FORCE, LENGTH, TIME, write

SLOW = TIME[::4]


def write_motion(path: Path) -> None:
    write(path, ["t (ms)", "L [mm]", "p_set [bar]", "F [N]"], [1e3 * TIME, LENGTH, COMMAND, FORCE])


@pytest.mark.parametrize("log", ["iso_{}_p.csv", "iso_{}.txt"])
def test_log_with_another_clock_belongs_to_the_trial_of_its_name(tmp_path: Path, log: str) -> None:
    for name in "ab":
        write_motion(tmp_path / f"iso_{name}.csv")
        write(tmp_path / log.format(name), ["Time (s)", "Pressure (kPa)"], [SLOW, 100.0 + 20.0 * SLOW])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert (draft.n_trials, draft.n_groups) == (2, 1)
    assert any(
        "iso_a.csv and " in remark and "files of one trial, and 1 more trials" in remark for remark in draft.remarks
    )
    trial = ks.load_dataset(tmp_path).trials[0]
    assert trial.measured["force"].time == pytest.approx(TIME)
    assert trial.measured["pressure"].time == pytest.approx(SLOW)


def test_log_beside_a_matlab_file_is_a_part_of_the_trial(tmp_path: Path) -> None:
    run = {"t": TIME, "x": LENGTH, "pset": COMMAND, "F": FORCE}
    savemat(tmp_path / "ramp.mat", {"run": run})
    write(tmp_path / "ramp-pressure.csv", ["Time (s)", "Pressure (bar)"], [SLOW, 1.0 + 0.2 * SLOW])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    assert 'time = ["`run.t` [s]", "`Time (s)` [s]"]' in draft.text
    assert draft.is_complete
    assert ks.load_dataset(tmp_path).trials[0].measured["pressure"].time == pytest.approx(SLOW)


def test_files_with_a_common_channel_or_other_names_are_trials(tmp_path: Path) -> None:
    write_motion(tmp_path / "iso.csv")
    write_motion(tmp_path / "iso_2.csv")
    write(tmp_path / "isobar.csv", ["Time (s)", "Pressure (kPa)"], [SLOW, 100.0 + 20.0 * SLOW])
    write(tmp_path / "iso_later.csv", ["Time (s)", "Pressure (kPa)"], [SLOW + 1e4, 100.0 + 20.0 * SLOW])
    assert ks.draft_dataset(tmp_path, DEVICE).n_trials == 4


def test_channel_that_some_files_lack_is_asked_for_in_their_trials(tmp_path: Path) -> None:
    write_motion(tmp_path / "a.csv")
    write(tmp_path / "b.csv", ["t (ms)", "p_set [bar]", "F [N]"], [1e3 * TIME, COMMAND, FORCE])
    draft = ks.draft_dataset(tmp_path, DEVICE)
    head, first, second = draft.text.split("[[trial]]")
    assert ["340 [mm]" in part for part in (head, first, second)] == [False, False, True]
    assert any("state it under [trial.columns], for example length" in remark for remark in draft.remarks)
    line = 'length = "340 [mm]"'
    draft.path.write_text(draft.text.replace(f"# {line}   # to do: no column was recognized", line))
    assert np.ptp(ks.load_dataset(tmp_path).trials[1].prescribed["length"].value) == 0.0
