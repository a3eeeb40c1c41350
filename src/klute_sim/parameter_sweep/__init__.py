"""Simulate every combination of listed inputs, on all cores or on a Ray cluster, and tabulate the metrics.

Order of dependence: ``fingerprint`` (software versions), ``plan`` (the cases), ``evaluate`` (one case), ``store`` and
``runner``, ``local`` and ``cluster`` (where cases run), ``sweep``, ``table`` and ``display``.
"""
