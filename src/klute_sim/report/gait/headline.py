"""First sentence on a gait run: the main results beside the reference."""

from typing import Any

from klute_sim.gait.metrics import AnkleMetrics
from klute_sim.gait.reference import MAX_GRF_TRACKING_RMS_BW
from klute_sim.report.gait.reference_text import describe_deviations

DISTANCES = ("angle", "moment", "power")
"""Curves of the ankle whose distance to people is known."""


def format_headline(summary: dict[str, Any], human: AnkleMetrics) -> str:
    """Return peak power, net work and peak moment of ``summary`` beside those of ``human``, in one sentence.

    A second one gives the distances to the reference in stance, where its standard deviations are known; a third says
    so if the run was not a gait.
    """
    power, moment = summary["ankle_power_peak_w_per_kg"], summary["ankle_moment_peak_nm_per_kg"]
    reference = "the reference" if not summary["slope_deg"] else "the reference on level ground"
    headline = (
        f"{summary['device']}: ankle power peaks at {power:.2f} W/kg "
        f"({_format_ratio(power, human.ankle_power_peak_w_per_kg)} of {reference}), the net ankle work of a stride is "
        f"{summary['ankle_work_net_j_per_kg']:+.3f} J/kg ({human.ankle_work_net_j_per_kg:+.3f}), and the ankle moment "
        f"peaks at {moment:.2f} N·m/kg ({_format_ratio(moment, human.ankle_moment_peak_nm_per_kg)})."
    )
    distances = [summary["distance_to_reference"][f"{name}_distance_sd"]["stance_rms"] for name in DISTANCES]
    if None not in distances:
        angle, moment_distance, power_distance = (f"{distance:.1f}" for distance in distances)
        headline += (
            f" In stance, angle, moment and power are {angle}, {moment_distance} and {power_distance} "
            f"{describe_deviations(summary['reference'])}."
        )
    if summary["touches_in_swing"]:
        return f"{headline} Caution: the foot trips in swing."
    if summary["grf_vertical_tracking_rms_bw"] > MAX_GRF_TRACKING_RMS_BW:
        return f"{headline} Caution: the ankle did not carry the load of the reference."
    return headline


def _format_ratio(value: float, human: float) -> str:
    return f"{100.0 * value / human:.0f} %" if human > 0.0 else f"{human:.2f}"
