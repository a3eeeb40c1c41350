"""Segmentation of a leg's channels into strides, and detection of repeated conditions.

``strides`` depends on :mod:`klute_sim.mocap.kinematics`; ``repeats`` compares the trials of
:mod:`klute_sim.mocap.prosthesis_trials`.
"""
