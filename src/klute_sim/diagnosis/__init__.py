"""Measured data against simulation: is there a gap, where, which effect is missing, and what is left with it."""
