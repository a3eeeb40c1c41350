"""Gymnasium environments of the prosthesis; importing ``klute_sim`` registers them.

Dependence, from the bottom: tasks; ankle_gait; ankle_gait_vector and ankle_bench; registration imports them by name.
"""
