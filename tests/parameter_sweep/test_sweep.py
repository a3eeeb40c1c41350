"""Sweeps evaluated in this process: order of cases, resumption, refused folders, and the content of the table."""

import errno
import json
import os
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
from klute_sim.parameter_sweep.store import RESULTS_FOLDER, ResultStore, open_store
from klute_sim.parameter_sweep.sweep import run_sweep
from klute_sim.recording.folder_lock import LOCK_FILE_NAME

DEVICE = load_device("klute-1-1-4-pair")
POWER = "ankle_power_peak [W/kg]"


def make_plan(**changes: object) -> SweepPlan:
    small = {"masses": (60.0, 75.0), "strides": 1, "dt": 1e-3}
    return SweepPlan(**{"devices": {"a": DEVICE}, "controllers": {"off": create_off_controller()}, **small, **changes})  # type: ignore[arg-type]


def open_plan_store(folder: Path, plan: SweepPlan) -> ResultStore:
    return open_store(folder, plan.describe(), "sweep")


class InProcessRunner:
    """Evaluates cases in this process and records them."""

    def __init__(self) -> None:
        self.cases: list[GaitCase] = []

    def __call__(self, cases: Iterable[GaitCase], on_result: ResultCallback) -> None:
        for case in cases:
            self.cases.append(case)
            on_result(case, evaluate_case(case))


def test_cases_come_in_the_given_order_with_the_last_list_varying_fastest() -> None:
    plan = make_plan(
        devices={"b": DEVICE, "a": DEVICE},
        controllers={"off": create_off_controller(), "low": ConstantPressure(1e5)},
        speeds=(1.2, None),
        slopes_deg=(3.0, -3.0),
        masses=(75.0, 60.0),
    )
    inputs = [
        (c.device_name, c.controller_name, c.subject.speed, c.subject.slope_deg, c.subject.mass)
        for c in plan.iter_cases()
    ]
    assert len(inputs) == 32
    assert inputs[:5] == [
        ("b", "off", 1.2, 3.0, 75.0),
        ("b", "off", 1.2, 3.0, 60.0),
        ("b", "off", 1.2, -3.0, 75.0),
        ("b", "off", 1.2, -3.0, 60.0),
        ("b", "off", None, 3.0, 75.0),
    ]
    assert inputs[8][1] == "low"
    assert inputs[16][0] == "a"


def test_references_provide_mass_and_stature_unless_the_plan_does() -> None:
    tall = replace(load_default_reference(), mass=90.0, stature=1.9)
    plan = make_plan(
        references={"tall": tall, "able-bodied": load_default_reference(), "csv": load_default_reference()},
        masses=(None,),
    )
    assert [(c.reference_name, c.subject.mass, c.subject.stature) for c in plan.iter_cases()] == [
        ("tall", 90.0, 1.9),
        ("able-bodied", 75.0, 1.75),
        ("csv", 75.0, 1.75),
    ]
    first, second, third = (case.build_options().reference for case in plan.iter_cases())
    assert first is tall
    assert second.digest == third.digest == load_default_reference().digest
    explicit = make_plan(references={"tall": tall}, masses=(60.0,), statures=(1.6, None))
    assert [(c.subject.mass, c.subject.stature) for c in explicit.iter_cases()] == [(60.0, 1.6), (60.0, 1.9)]
    assert explicit.describe()["references"]["tall"]["mass_kg"] == 90.0
    with pytest.raises(InputError, match="stature is 3; allowed"):
        make_plan(statures=(3.0,))


def test_passive_feet_come_after_the_devices_with_controller_off() -> None:
    feet = {4.0: DEVICE, 6.0: DEVICE}
    plan = make_plan(controllers={"low": ConstantPressure(1e5)}, masses=(None,), spring_feet=feet)
    inputs = [(c.device_name, c.controller_name, c.controller.describe(), c.foot_stiffness) for c in plan.iter_cases()]
    off = create_off_controller().describe()
    assert inputs[1:] == [("spring foot 4", "off", off, 4.0), ("spring foot 6", "off", off, 6.0)]
    assert inputs[0][::3] == ("a", None)
    with pytest.raises(InputError):
        make_plan(spring_feet={-1.0: DEVICE})


@pytest.mark.slow
def test_resumed_sweep_evaluates_only_missing_and_damaged_results(tmp_path: Path) -> None:
    plan = make_plan()
    first, fractions = InProcessRunner(), list[float]()
    rows, n_resumed = run_sweep(plan, open_plan_store(tmp_path / "s", plan), first, fractions.append)
    assert [c.subject.mass for c in first.cases] == [60.0, 75.0]
    assert (n_resumed, fractions) == (0, [0.0, 0.5, 1.0])
    assert all(row["failure"] is None for row in rows)
    files = {c.subject.mass: tmp_path / "s" / RESULTS_FOLDER / f"{c.key}.json" for c in first.cases}
    marked = json.loads(files[60.0].read_text())
    marked["metrics"][POWER] = 123.0
    files[60.0].write_text(json.dumps(marked))
    files[75.0].write_text(files[75.0].read_text()[:40])

    second, fractions = InProcessRunner(), []
    resumed_rows, n_resumed = run_sweep(plan, open_plan_store(tmp_path / "s", plan), second, fractions.append)
    assert [c.subject.mass for c in second.cases] == [75.0]
    assert (n_resumed, fractions) == (1, [0.5, 1.0])
    assert [row[POWER] for row in resumed_rows] == [123.0, rows[1][POWER]]
    third = InProcessRunner()
    assert run_sweep(plan, open_plan_store(tmp_path / "s", plan), third)[0] == resumed_rows
    assert third.cases == []


def test_equal_cases_under_two_names_are_evaluated_once(tmp_path: Path) -> None:
    runner, plan = InProcessRunner(), make_plan(devices={"a": DEVICE, "b": DEVICE}, masses=(60.0,))
    rows, _ = run_sweep(plan, open_plan_store(tmp_path / "s", plan), runner)
    assert len(runner.cases) == 1
    assert [row.pop("device") for row in rows] == ["a", "b"]
    assert rows[0] == rows[1]


@pytest.mark.slow
def test_full_disk_keeps_finished_cases(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, write_atomically = make_plan(), store.write_atomically
    result_store = open_plan_store(tmp_path / "s", plan)

    def fill_disk(path: Path, text: str) -> None:
        if any(path.parent.glob("*.json")):
            raise OSError(errno.ENOSPC, "No space left on device")
        write_atomically(path, text)

    monkeypatch.setattr(store, "write_atomically", fill_disk)
    with pytest.raises(KluteSimError, match="the disk is full: finished cases are kept"):
        run_sweep(plan, result_store, InProcessRunner())
    monkeypatch.undo()
    runner = InProcessRunner()
    assert run_sweep(plan, open_plan_store(tmp_path / "s", plan), runner)[1] == 1
    assert [c.subject.mass for c in runner.cases] == [75.0]


def test_sweep_killed_before_its_plan_was_stored_starts_again(tmp_path: Path) -> None:
    folder, plan = tmp_path / "s", make_plan()
    (folder / RESULTS_FOLDER).mkdir(parents=True)
    (folder / LOCK_FILE_NAME).write_text("99999999")
    (folder / ".99999999-1.sweep.json").write_text("{")
    open_plan_store(folder, plan)
    assert sorted(path.name for path in folder.iterdir()) == [RESULTS_FOLDER, "sweep.json"]


@pytest.mark.slow
def test_leftovers_of_a_killed_sweep_disappear(tmp_path: Path) -> None:
    folder, plan = tmp_path / "s", make_plan()
    run_sweep(plan, open_plan_store(folder, plan), InProcessRunner())
    (folder / RESULTS_FOLDER / ".99999999-1.a.json").write_text("{")
    (folder / ".99999999-1.sweep.parquet").write_text("half")
    assert run_sweep(plan, open_plan_store(folder, plan), InProcessRunner())[1] == 2
    assert list(folder.rglob(".*")) == []


def test_folder_in_use_is_refused(tmp_path: Path) -> None:
    plan = make_plan()
    with open_plan_store(tmp_path / "s", plan).lock():
        for attempt in (lambda: open_plan_store(tmp_path / "s", plan), ResultStore(tmp_path / "s").lock):
            with pytest.raises(InputError, match=f"in use by process {os.getpid()}"):
                attempt()
    with open_plan_store(tmp_path / "s", plan).lock():
        pass


def test_documentation_lists_every_column() -> None:
    page = (Path(__file__).parents[2] / "docs" / "sweep.md").read_text("utf-8")
    for column in table.COLUMN_TYPES:
        assert f"`{column}`" in page, column


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        ({"masses": (60.0,)}, "other masses"),
        ({"controllers": {"off": ConstantPressure(1e5)}}, "other controllers"),
        ({"slopes_deg": (1.0,), "dt": 5e-4}, "other slopes, time"),
        ({"devices": {"a": load_device("klute-1-1-4-pair-valve")}}, "other devices"),
    ],
)
def test_folder_of_another_sweep_is_refused(change: dict[str, object], difference: str, tmp_path: Path) -> None:
    open_plan_store(tmp_path / "s", make_plan())
    with pytest.raises(InputError, match=f"holds another sweep \\({difference}\\)"):
        open_plan_store(tmp_path / "s", make_plan(**change))


def test_parquet_table_is_typed_and_contains_the_plan(tmp_path: Path) -> None:
    plan = make_plan(devices={"a": DEVICE, "no": load_device("klute-3-4")}, masses=(60.0,))
    rows, _ = run_sweep(plan, open_plan_store(tmp_path / "s", plan), InProcessRunner())
    table.write_parquet(rows, plan, tmp_path / "t.parquet")
    parquet = pq.read_table(tmp_path / "t.parquet")
    assert parquet.to_pylist() == rows
    assert parquet.schema.names == list(table.COLUMN_TYPES)
    names = ("device", "strides [1]", "toe_off [%]", "trips", "failure")
    types = [pa.string(), pa.int64(), pa.float64(), pa.bool_(), pa.string()]
    assert [parquet.schema.field(name).type for name in names] == types
    assert parquet.schema.field("mass [kg]").metadata == {b"unit": b"kg"}
    assert json.loads(parquet.schema.metadata[b"klute_sim"]) == json.loads(json.dumps(plan.describe()))
    assert parquet.column("trips").to_pylist() == [False, None]
    assert "no [tendon] section" in parquet.column("failure").to_pylist()[1]
