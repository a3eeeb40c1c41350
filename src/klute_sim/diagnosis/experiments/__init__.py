"""Measured trials prepared for simulation.

In order of dependence: ``base`` (what every experiment offers), ``denoise`` (prescribed channels), ``bench`` and
``gait`` (one experiment type per rig), ``prepare`` (all trials of a dataset), ``simulator`` (runs many experiments).
"""
