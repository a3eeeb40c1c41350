"""Tests that every comparison can fail: a constant of the model that differs from the source fails its own item."""

from typing import Any

import pytest

from klute_sim.device.device import Device, load_device
from klute_sim.laws import hill_tables as tables
from klute_sim.reproduction import printed
from klute_sim.reproduction.chapters import chapter2, chapter3
from klute_sim.reproduction.item import Outcome, assess

RELATIVE_CHANGE = 1e-5
"""Relative change of a constant, ten times the tolerance of round trips."""
ITEMS = {item.id: item for item in printed.list_items()}
TABLE_FIELDS = (
    ("table-2.1", tables.PARALLEL_ELEMENTS, ("k1", "k2")),
    ("table-2.3", tables.CONTRACTILE_ELEMENTS, ("k5", "k6", "k7")),
    ("table-2.4", tables.HILL_CURVES, ("a", "b")),
)
DEVICE_KEYS = {
    "turns": "turns_per_m",
    "l0": "resting_length_mm",
    "braid": "braid_length_ratio",
    "r0": "bladder_radius_mm",
    "t0": "bladder_thickness_mm",
    "m": "friction_slope_n_per_bar",
    "b": "friction_offset_n",
}
"""Keys of a device file by item of Table 3.1."""


def find_disagreements(findings: dict[str, Outcome]) -> set[str]:
    return {name for name, finding in findings.items() if assess(ITEMS[name], finding).verdict == "contradicts-source"}


@pytest.mark.parametrize(
    ("table_id", "table", "name", "field"),
    [(table_id, table, name, field) for table_id, table, fields in TABLE_FIELDS for name in table for field in fields],
)
def test_wrong_constant_of_a_row_fails_its_item(
    monkeypatch: pytest.MonkeyPatch, table_id: str, table: dict[str, Any], name: str, field: str
) -> None:
    law = table[name].constants
    wrong_law = law._replace(**{field: (1.0 + RELATIVE_CHANGE) * getattr(law, field)})
    monkeypatch.setitem(table, name, table[name]._replace(constants=wrong_law))
    assert f"{table_id}.{name}.{field}" in find_disagreements(chapter2.compute().findings)


@pytest.mark.parametrize("name", tables.SERIES_ELEMENTS)
@pytest.mark.parametrize("field", ["k3", "k4"])
def test_wrong_constant_of_the_series_element_fails_its_item(
    monkeypatch: pytest.MonkeyPatch, name: str, field: str
) -> None:
    law = tables.SERIES_ELEMENTS[name]
    wrong_law = law._replace(**{field: (1.0 + RELATIVE_CHANGE) * getattr(law, field)})
    monkeypatch.setitem(tables.SERIES_ELEMENTS, name, wrong_law)
    assert f"table-2.2.{name}.{field}" in find_disagreements(chapter2.compute().findings)


@pytest.mark.parametrize("preset", chapter3.PRESETS)
def test_wrong_number_of_a_device_file_fails_its_item(monkeypatch: pytest.MonkeyPatch, preset: str) -> None:
    nominal = load_device(preset)
    size = preset.removeprefix("klute-")
    assert not {name for name in find_disagreements(chapter3.compute().findings) if name.startswith("table-3.1")} - {
        "table-3.1.1-1-4.radius"  # contradicts the source here, where no implied value is given
    }
    for item, key in DEVICE_KEYS.items():
        value = nominal.spec.collect_values()[f"muscle.{key}"]
        changed = nominal.with_changes({f"muscle.{key}": (1.0 + RELATIVE_CHANGE) * value}, "wrong")

        def load(name: str, changed: Device = changed) -> Device:
            return changed if name == preset else load_device(name)

        monkeypatch.setattr(chapter3, "load_device", load)
        assert f"table-3.1.{size}.{item}" in find_disagreements(chapter3.compute().findings), item
