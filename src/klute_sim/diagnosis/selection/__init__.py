"""Selection of effects.

Modules in order of dependence: ``screening`` and ``pair_screening`` (linear prediction of gains), ``naming`` (obstacles
to a name) and ``bounds``, ``forward_selection``, ``robustness`` (smaller models, multi-start convergence, equivalent
models), ``predictive_model`` and ``predictive_selection`` (where the law is imperfect).
"""
