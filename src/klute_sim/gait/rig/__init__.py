"""The gait rig, a robotic gait simulator that walks the prosthesis on measured gait.

From bottom to top: ``trajectory``, ``build`` (model), ``setup`` (model, trajectory and commands of a rig), ``sensors``,
``commands``, ``measurements`` and ``rig`` (the simulation).
"""
