"""Experiments: what is prescribed and what is measured."""
