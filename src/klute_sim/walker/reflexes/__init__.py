"""Reflexes of the walker: their laws, their gains, and the files of walkers."""
