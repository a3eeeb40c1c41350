"""Measured trials prepared for simulation.

In order of dependence: ``held_samples`` and ``interpolated_samples`` (slow instruments), ``denoise``,
``quantized_inputs``, ``interpolation`` and ``initial_motion`` (prescribed channels), ``channel_filter``, ``low_pass``,
``window_filter`` and ``mains_hum`` (how channels were recorded), ``registration``; ``base`` (what every experiment
offers), ``bench``, ``gait`` and ``mechanism`` (one experiment type per rig), ``prepare`` (all trials of a dataset),
``simulator`` (runs many experiments).
"""
