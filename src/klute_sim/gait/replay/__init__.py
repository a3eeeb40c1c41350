"""The replay rig: the prosthesis on a shank that moves as measured, under the measured ground reaction.

``foot`` gives the foot of a device, ``prescribed`` prepares the motion and load of a trial, ``rollout`` simulates it.
"""
