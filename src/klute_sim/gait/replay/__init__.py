"""The replay rig: the prosthesis on a shank that moves as measured, under the measured ground reaction."""
