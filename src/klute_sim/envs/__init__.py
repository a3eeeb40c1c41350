"""Gymnasium environments of the prosthesis; importing ``klute_sim`` registers them.

Dependence, from the bottom: base, tasks, and the environments; the vector form of an environment imports the single
one. registration imports them by name.
"""
