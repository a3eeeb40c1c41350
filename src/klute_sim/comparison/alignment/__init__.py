"""Alignment of recordings: common axis, channels, units and trials.

Order of dependence: ``resample`` (axis), ``channels`` (names), ``foot_strikes`` (gait phase of measured recordings),
``unit_conversion``, ``matching`` (trials and channels that can be compared).
"""
