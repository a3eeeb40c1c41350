"""``ks.import_gait``, ``ks.import_dataset`` and ``ks.export_run``: results, files and messages."""

import json
from pathlib import Path

import pytest

import klute_sim as ks
from tests import synthetic_gait


@pytest.mark.slow
def test_imported_gait_is_reference_for_simulation(tmp_path: Path) -> None:
    files = synthetic_gait.opensim(tmp_path, synthetic_gait.Walker())
    result = ks.import_gait(files, mass=70.0, stature=1.8)
    assert (result.reference.mass, result.reference.stature) == (70.0, 1.8)
    assert result.reference.stride_time == pytest.approx(1.1, abs=1e-3)
    assert repr(result).startswith("GaitImport(3 strides, right, 1.1")
    assert "3 strides of the right leg" in str(result)
    folder = result.save(tmp_path / "me")
    assert json.loads((folder / "import.json").read_text())["mass_kg"] == 70.0
    assert ks.load_reference(folder).mass == pytest.approx(70.0)
    assert result.plot().axes


def test_imported_gait_is_exported(tmp_path: Path) -> None:
    files = synthetic_gait.opensim(tmp_path, synthetic_gait.Walker())
    folder = ks.import_gait(files, mass=70.0).save(tmp_path / "me")
    exported, names = ks.export_run(folder, tmp_path / "out", formats=["mot"])
    assert names == ["angles.mot", "ground_reaction.mot"]
    assert sorted(file.name for file in exported.iterdir()) == names
    with pytest.raises(ks.InputError, match="unknown format 'x'; allowed: mot, sto"):
        ks.export_run(folder, tmp_path / "other", formats=["x"])


def test_dataset_without_prosthesis_log_is_refused(tmp_path: Path) -> None:
    files = synthetic_gait.opensim(tmp_path, synthetic_gait.Walker())
    with pytest.raises(ks.InputError, match="no trial of these files can be replayed"):
        ks.import_dataset(files, "klute-1-1-4-pair", side="right")
