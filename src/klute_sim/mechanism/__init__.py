"""Mechanisms: MJCF models with one or more devices on their tendons, simulated under prescribed inputs.

In order of dependence: ``drives`` (prescribed motion and loads), ``assembly`` (model, devices and drives together),
``rest`` (the state at the start), ``simulate`` (a rollout) and ``record`` (a recording with one energy balance per
device). Tests of joints are in ``protocols``, ``metrics``, ``mounting`` and ``run``.
"""
