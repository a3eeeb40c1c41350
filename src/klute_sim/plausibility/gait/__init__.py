"""What is plausible in measured gait: references over the cycle, trials over time, and markers.

Limits are anatomy and mechanics, far wider than any norm: running, slopes, children, crutches and stiff ankles are
plausible. In order of dependence: ``steps`` (contacts with the ground), ``angles`` (unit, zero and wraps of one angle),
``loads`` (units of forces and moments), ``shapes`` (curves over the cycle), ``cycle`` (a reference), ``motion`` and
``trial`` (recordings), ``markers``.
"""
