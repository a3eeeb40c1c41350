"""Pressure controllers: what is asked of the regulator, and when."""
