"""Plausibility of a trial on the tensile tester, from the limits and a simulation of its device.

In order of dependence: ``trial`` (channels of a trial and limits of its device), ``magnitudes`` (missing-value codes
and units by range), ``time_axis``, ``agreement`` (measured against simulated channels), ``mistakes`` (mistakes that
a simulation can confirm), ``measured`` (units and signs of measured channels), ``check`` (all of them in order).
"""
