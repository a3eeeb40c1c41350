"""Plausibility of the trials on the tensile tester, from the limits and a simulation of their devices.

In order of dependence: ``trial`` (channels of a trial and limits of its device), ``magnitudes`` (missing-value codes
and units by range), ``time_axis``, ``agreement`` (measured against simulated channels), ``dropouts``, ``causality``,
``mistakes`` (mistakes that a simulation can confirm), ``assessment`` (a trial with and without them), ``others`` (what
the trials with the same columns say about a mistake), ``absolute_pressures``, ``geometry`` (forces of a specimen),
``check`` (all of them in order).
"""
