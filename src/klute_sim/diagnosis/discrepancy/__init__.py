"""Data-driven terms for what no effect explains, and the names that they refuse.

Modules in order of dependence: ``sparse_regression`` (the term of an equation), ``data_driven_rival`` (where models
reach the noise) and ``data_driven_comparison`` (where the law is imperfect).
"""
