"""Sweeps with walks done in place: what is kept, gone on with, refused, and what is in the table."""

import errno
import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from klute_sim.controllers.pressure import ConstantPressure, create_off_controller
from klute_sim.device.device import load_device
from klute_sim.errors import InputError, KluteSimError
from klute_sim.gait.reference import load_default_reference
from klute_sim.parameter_sweep import store, table
from klute_sim.parameter_sweep.evaluate import evaluate_case
from klute_sim.parameter_sweep.plan import GaitCase, SweepPlan
from klute_sim.parameter_sweep.runner import ResultCallback
from klute_sim.parameter_sweep.store import open_store
from klute_sim.parameter_sweep.sweep import run_sweep

DEVICE = load_device("klute-1-1-4-pair")
POWER = "ankle_power_peak [W/kg]"


def plan(**changes: object) -> SweepPlan:
    small = {"masses": (60.0, 75.0), "strides": 1, "step": 1e-3}
    return SweepPlan(**{"devices": {"a": DEVICE}, "controllers": {"off": create_off_controller()}, **small, **changes})  # type: ignore[arg-type]


class Here:
    """Walks in this process, and remembers what it walked."""

    def __init__(self) -> None:
        self.walked: list[GaitCase] = []

    def __call__(self, combinations: Iterable[GaitCase], finished: ResultCallback) -> None:
        for combination in combinations:
            self.walked.append(combination)
            finished(combination, evaluate_case(combination))


def test_combinations_come_in_the_order_given_the_last_one_changing_first() -> None:
    planned = plan(
        devices={"b": DEVICE, "a": DEVICE},
        controllers={"off": create_off_controller(), "low": ConstantPressure(1e5)},
        speeds=(1.2, None),
        slopes_deg=(3.0, -3.0),
        masses=(75.0, 60.0),
    )
    listed = [
        (c.device_name, c.controller_name, c.speed, c.slope_deg, c.mass) for c in planned.iter_cases()
    ]  # fmt: skip
    assert len(listed) == 32
    assert listed[:5] == [
        ("b", "off", 1.2, 3.0, 75.0),
        ("b", "off", 1.2, 3.0, 60.0),
        ("b", "off", 1.2, -3.0, 75.0),
        ("b", "off", 1.2, -3.0, 60.0),
        ("b", "off", None, 3.0, 75.0),
    ]
    assert listed[8][1] == "low"
    assert listed[16][0] == "a"


def test_walkers_bring_their_mass_and_stature_unless_told_otherwise() -> None:
    big = replace(load_default_reference(), mass=90.0, stature=1.9)
    planned = plan(references={"big": big, "able-bodied": None, "csv": load_default_reference()}, masses=(None,))
    assert [(c.reference_name, c.mass, c.stature) for c in planned.iter_cases()] == [
        ("big", 90.0, 1.9),
        ("able-bodied", 75.0, 1.75),
        ("csv", 75.0, 1.75),
    ]
    first, second, third = planned.iter_cases()
    assert first.build_options().reference is big
    assert (
        second.build_options().reference.digest
        == third.build_options().reference.digest
        == load_default_reference().digest
    )
    told = plan(references={"big": big}, masses=(60.0,), statures=(1.6, None))
    assert [(c.mass, c.stature) for c in told.iter_cases()] == [(60.0, 1.6), (60.0, 1.9)]
    assert told.describe()["references"]["big"]["mass_kg"] == 90.0
    with pytest.raises(InputError, match="stature is 3; allowed"):
        plan(statures=(3.0,))


def test_passive_feet_come_after_the_devices_without_pressure() -> None:
    planned = plan(controllers={"low": ConstantPressure(1e5)}, masses=(None,), feet={4.0: DEVICE, 6.0: DEVICE})
    listed = [
        (c.device_name, c.controller_name, c.controller.describe(), c.foot_stiffness) for c in planned.iter_cases()
    ]
    no = create_off_controller().describe()
    assert listed[1:] == [("spring foot 4", "off", no, 4.0), ("spring foot 6", "off", no, 6.0)]
    assert listed[0][::3] == ("a", None)
    with pytest.raises(InputError):
        plan(feet={-1.0: DEVICE})


def test_what_is_finished_is_not_walked_again_and_what_the_disk_lost_is(tmp_path: Path) -> None:
    first, told = Here(), list[float]()
    swept = run_sweep(plan(), open_store(tmp_path / "s", plan().describe(), "sweep"), first, told.append)
    assert [c.mass for c in first.walked] == [60.0, 75.0]
    assert (swept.n_resumed, swept.n_failed, told) == (0, 0, [0.0, 0.5, 1.0])
    files = {c.mass: tmp_path / "s" / "walks" / f"{c.key}.json" for c in first.walked}
    marked = json.loads(files[60.0].read_text())
    marked["outcomes"][POWER] = 123.0
    files[60.0].write_text(json.dumps(marked))
    files[75.0].write_text(files[75.0].read_text()[:40])

    second, told = Here(), []
    again = run_sweep(plan(), open_store(tmp_path / "s", plan().describe(), "sweep"), second, told.append)
    assert [c.mass for c in second.walked] == [75.0]
    assert (again.n_resumed, told) == (1, [0.5, 1.0])
    assert [row[POWER] for row in again.rows] == [123.0, swept.rows[1][POWER]]
    third = Here()
    assert run_sweep(plan(), open_store(tmp_path / "s", plan().describe(), "sweep"), third).rows == again.rows
    assert third.walked == []


def test_two_names_for_the_same_are_two_rows_of_one_walk(tmp_path: Path) -> None:
    here, planned = Here(), plan(devices={"a": DEVICE, "b": DEVICE}, masses=(60.0,))
    rows = run_sweep(planned, open_store(tmp_path / "s", planned.describe(), "sweep"), here).rows
    assert len(here.walked) == 1
    assert [row.pop("device") for row in rows] == ["a", "b"]
    assert rows[0] == rows[1]


def test_a_full_disk_keeps_what_was_finished(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept, write = open_store(tmp_path / "s", plan().describe(), "sweep"), store.write_atomically

    def full(file: Path, text: str) -> None:
        if any(file.parent.glob("*.json")):
            raise OSError(errno.ENOSPC, "No space left on device")
        write(file, text)

    monkeypatch.setattr(store, "write_atomically", full)
    with pytest.raises(KluteSimError, match="the disk is full: what was walked so far is kept"):
        run_sweep(plan(), kept, Here())
    monkeypatch.undo()
    here = Here()
    assert run_sweep(plan(), open_store(tmp_path / "s", plan().describe(), "sweep"), here).n_resumed == 1
    assert [c.mass for c in here.walked] == [75.0]


def test_a_file_that_cannot_be_written_whole_is_not_there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def half(file: Path, text: str, encoding: str) -> None:
        with file.open("w") as out:
            out.write(text[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", half)
    with pytest.raises(OSError, match="No space"):
        store.write_atomically(tmp_path / "x.json", "0123456789abc")
    assert list(tmp_path.iterdir()) == []


def test_the_documented_table_of_columns_is_complete() -> None:
    page = (Path(__file__).parents[2] / "docs" / "sweep.md").read_text("utf-8")
    for heading in table.COLUMN_TYPES:
        assert f"`{heading}`" in page, heading


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"masses": (60.0,)}, "other masses"),
        ({"controllers": {"off": ConstantPressure(1e5)}}, "other controllers"),
        ({"slopes_deg": (1.0,), "step": 5e-4}, "other slopes, step"),
        ({"devices": {"a": load_device("klute-1-1-4-pair-valve")}}, "other devices"),
    ],
)
def test_a_folder_of_another_sweep_is_refused(change: dict[str, object], what: str, tmp_path: Path) -> None:
    open_store(tmp_path / "s", plan().describe(), "sweep")
    with pytest.raises(InputError, match=f"holds another sweep \\({what}\\)"):
        open_store(tmp_path / "s", plan(**change).describe(), "sweep")


def test_the_table_is_typed_and_says_what_made_it(tmp_path: Path) -> None:
    planned = plan(devices={"a": DEVICE, "no": load_device("klute-3-4")}, masses=(60.0,))
    rows = run_sweep(planned, open_store(tmp_path / "s", planned.describe(), "sweep"), Here()).rows
    table.write_parquet(rows, planned, tmp_path / "t.parquet")
    read = pq.read_table(tmp_path / "t.parquet")
    assert read.to_pylist() == rows
    assert read.schema.names == list(table.COLUMN_TYPES)
    assert [read.schema.field(name).type for name in ("device", "strides [1]", "toe_off [%]", "trips", "failure")] == [
        pa.string(), pa.int64(), pa.float64(), pa.bool_(), pa.string(),
    ]  # fmt: skip
    assert read.schema.field("mass [kg]").metadata == {b"unit": b"kg"}
    assert json.loads(read.schema.metadata[b"klute_sim"]) == json.loads(json.dumps(planned.describe()))
    assert read.column("trips").to_pylist() == [False, None]
    assert "no [tendon] section" in read.column("failure").to_pylist()[1]
