"""Motion and loads of one leg, from joint angles or from markers.

Order of dependence: ``filters`` and ``joints``; ``from_markers`` (landmarks) and ``dynamics``; ``loads`` (ground
reactions of the feet); ``postprocess`` (contacts, signs, zeros); ``leg``; ``from_joint_angles`` (legs from angles that
other programs computed); ``prosthesis_kinematics`` (prescribed motion of a replay).
"""
