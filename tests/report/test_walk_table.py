"""Remarks of a walk: joint angles that differ from those of people are named."""

from typing import Any

from klute_sim.report.walk.table import collect_remarks


def make_summary(hip_rms: float, ankle_correlation: float) -> dict[str, Any]:
    human = {joint: {"correlation": 0.95, "rms": 5.0} for joint in ("hip", "knee", "ankle", "grf_vertical")}
    prosthetic = {
        **human,
        "hip": {"correlation": 0.96, "rms": hip_rms},
        "ankle": {"correlation": ankle_correlation, "rms": 5.0},
    }
    legs = {"left": {"likeness": human}, "right": {"likeness": prosthetic}}
    absent = {"cost_bhargava_j_per_kg_m": None, "step_asymmetry": None, "push_n_s": 0.0, "has_been_pushed": False}
    return {**absent, "walker": {"name": "mine"}, "is_acute": False, "prosthesis": "device", "legs": legs}


def test_joint_angles_unlike_those_of_people_are_named() -> None:
    remarks = " ".join(collect_remarks(make_summary(hip_rms=12.0, ankle_correlation=0.7)))
    assert (
        "differ from those of people: hip of the prosthetic leg (r = 0.96, 12 deg rms); "
        "ankle of the prosthetic leg (r = 0.70, 5 deg rms)."
    ) in remarks
    assert "differ from" not in " ".join(collect_remarks(make_summary(hip_rms=9.0, ankle_correlation=0.9)))


def test_walk_that_falls_before_its_push_says_so() -> None:
    summary = make_summary(hip_rms=5.0, ankle_correlation=0.9) | {"push_n_s": 10.0, "push_phase_pct": 40.0}
    assert "The person falls before the push." in collect_remarks(summary)
    pushed = "Push on the hip: +10 N·s at 40 % of the right leg's first stride after 5 s."
    assert pushed in collect_remarks(summary | {"has_been_pushed": True})
    for has_fallen, end in ((True, "no mean stride."), (False, "no mean stride: walk longer.")):
        assert collect_remarks(summary | {"legs": {}, "has_fallen": has_fallen})[0].endswith(end)
