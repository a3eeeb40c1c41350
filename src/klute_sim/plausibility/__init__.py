"""What is plausible in measured channels and device files, and the likely mistake where something is not.

Pure functions of arrays and numbers, which every reader of a user's file may call. In order of dependence: ``finding``
(one mistake, and the error for mistakes that the user has not accepted), ``units`` (the unit that numbers seem to
have), ``samples`` (missing-value codes, signs, exchanged columns, time axes).

A limit without a source beside it is assumed: wide enough for what we know of muscles, testers and walking people.
"""
