"""Diagnosis: which effects the simulation of measured trials lacks.

Packages and modules in order of dependence: ``experiments`` (trials ready to be simulated), ``noise``,
``data_quality``, ``fitting``, ``selection`` (of effects), ``planning`` (of measurements), ``result``, ``device_file``,
``verdict`` and ``workflow``.
"""
