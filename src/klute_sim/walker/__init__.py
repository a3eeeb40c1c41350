"""A person who walks by muscles and reflexes: a predicted gait, with or without a prosthesis.

From bottom to top: ``person`` (muscles, and the model in MuJoCo), ``reflexes`` (their laws, gains and files),
``simulation`` (time steps, commands, recordings), ``outcomes`` (what a walk shows) and ``adaptation`` (search of
gains).
"""
