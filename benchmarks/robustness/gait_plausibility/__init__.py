"""Gait files that are wrong in a known way, and unusual ones that are right, with what the readers must say.

``python -m benchmarks.robustness.gait_plausibility`` prints the table. In order of dependence: ``walker`` (made gait),
``files`` (references, datasets and motion files of a walker), ``wrong`` and ``right`` (variants).
"""
