"""Simulation of a walk: state, time steps in two backends, commands to the prosthesis, and recordings."""
