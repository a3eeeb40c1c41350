"""Reproduction of the dissertation: each printed item, the computed value and an assessment.

Dependence, from the bottom: item and curves; printed (the published items); implied_values; chapters (the
computations); run (all items); summary (counts); assumptions (influence of assumed device values).
"""
