"""The gait rig: a robotic gait simulator that walks the prosthesis on measured gait."""
