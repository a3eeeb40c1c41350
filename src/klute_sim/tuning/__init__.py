"""Tuning of controllers, and of devices together with them, on the gait rig."""
