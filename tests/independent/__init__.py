"""Checks of the simulation by code that shares nothing with the laws of the package."""
