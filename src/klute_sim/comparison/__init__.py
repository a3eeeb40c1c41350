"""Comparison of recordings: all strides or repeats on one axis, mean curves with bands, and their differences.

Order of dependence: ``remarks``, ``runs`` (input), ``curve``, ``difference``, ``alignment`` (common units, channels and
axis), ``source`` (curves of one series), ``comparison`` (the workflow), ``results`` (files).
"""
