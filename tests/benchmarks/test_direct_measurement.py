"""Direct measurements on the plant of the benchmark refute what is not hidden, and confirm what is."""

from typing import Any

import pytest
from benchmarks.hidden_effects.direct_measurement import list_refuted_names

TURNS = "number_error@muscle.turns_per_m"
VERDICT: dict[str, Any] = {
    "verdict": "indistinguishable",
    "effects": [{"name": "end_taper", "channel": None, "number": None}],
    "alternatives": [[TURNS], ["sensor_gain@force"]],
    "direct_measurements": [
        {
            **{"name": TURNS, "quantity": "muscle.turns_per_m", "expected": 60.0, "low": 59.5, "high": 60.5},
            **{"otherwise": 57.0, "accuracy": 0.3},
        },
        {
            **{"name": "sensor_gain@force", "quantity": "gain", "expected": 1.06, "low": 1.05, "high": 1.07},
            **{"otherwise": 1.0, "accuracy": 0.005},
        },
    ],
}


def make_truth(**hidden: list[dict[str, Any]]) -> dict[str, Any]:
    return {"seed": 7, "effects": [], "instruments": [], "numbers": [], "strangers": [], **hidden}


@pytest.mark.parametrize(
    ("hidden", "refuted"),
    [
        ({"effects": [{"name": "end_taper", "parameters": {"factor": 1.0}}]}, (TURNS, "sensor_gain@force")),
        (
            {
                "numbers": [
                    {"name": "number_error", "number": "muscle.turns_per_m", "parameters": {"muscle.turns_per_m": 60.1}}
                ]
            },
            ("end_taper", "sensor_gain@force"),
        ),
        (
            {"instruments": [{"name": "sensor_gain", "channel": "force", "parameters": {"gain": 1.061}}]},
            ("end_taper", TURNS),
        ),
    ],
)
def test_measurements_leave_only_what_is_hidden(hidden: dict[str, Any], refuted: tuple[str, ...]) -> None:
    assert set(list_refuted_names(make_truth(**hidden), VERDICT)) == set(refuted)


def test_nothing_is_refuted_without_a_measurement() -> None:
    assert list_refuted_names(make_truth(), {**VERDICT, "direct_measurements": []}) == ()
