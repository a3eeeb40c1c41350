"""Simulate every combination of listed inputs, on all cores or on a Ray cluster, and tabulate the metrics.

Order of dependence: ``fingerprint`` (software versions), ``plan`` and ``walk_plan`` (the cases of gait runs and of
predicted walks), ``evaluate`` with ``walk_metrics`` (one case), ``store`` and ``runner``, ``local`` and ``cluster``
(where cases run), ``table``, ``sweep``, ``display`` and ``walk_display``.
"""
