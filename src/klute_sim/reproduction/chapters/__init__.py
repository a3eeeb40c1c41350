"""Computation of the printed items and figures, one module per chapter of the dissertation."""
