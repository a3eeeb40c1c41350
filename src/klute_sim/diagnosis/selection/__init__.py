"""Selection of effects.

Modules in order of dependence: ``screening`` (linear prediction of gains), ``forward_selection``, ``robustness``
(smaller models, multi-start convergence, equivalent models), ``localization`` and ``equation_residuals`` (where the
misfit is), and ``sparse_regression`` (a data-driven term where no effect explains the data).
"""
