"""Adaptation of reflexes to a condition: objective and search."""
