"""Planning of measurements.

Modules in order of dependence: ``measurement_plan`` (commands and instructions for a tensile tester), ``proposals``
(the experiment that separates two models), ``next_experiment`` (that of a verdict), ``identifiability`` (which effects
look alike, and on which rig they differ) and ``signatures`` (the response to one effect).
"""
