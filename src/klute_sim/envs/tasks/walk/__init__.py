"""The task of ``klute_sim/AnkleWalk``: a person with a prosthesis who walks by muscles and reflexes.

From bottom to top: ``reward``, ``options``, ``person`` (one simulation) and ``task`` (many of them).
"""
