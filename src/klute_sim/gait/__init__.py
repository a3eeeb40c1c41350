"""Gait: the simulated gait rig, the replay of measured gait, and the metrics of a gait run.

From bottom to top: ``reference_folder`` and ``reference`` (normative gait), ``contacts``, ``spring_foot``, ``body``
(the foot of the MJCF), ``foot_section`` (its numbers), ``rig`` (simulation in MuJoCo), ``foot_bench`` (bench test of a
foot), ``replay`` (simulation of measured trials) and ``metrics``.
"""
