"""Fits of the device and of additional effects to measured trials.

In order of dependence: ``hypothesis`` (the model and its parameters), ``fit_cache``, ``least_squares``,
``systematic_error`` and ``confidence_intervals``.
"""
