"""Gymnasium environments of the prosthesis; importing ``klute_sim`` registers them.

Dependence, from the bottom: tasks and base; ankle_gait; ankle_gait_vector and ankle_bench; ankle_bench_vector;
registration imports them by name.
"""
