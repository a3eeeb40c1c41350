"""Recognition of files, columns, markers, units and signs.

Order of dependence: ``channel_names`` (labels), ``mapping`` (the user's assignments), ``sources`` (files grouped into
trials), ``conventions`` (signs, zeros and units by plausibility), ``channel_lookup`` (columns in standard units),
``markers`` (marker roles and the walking frame), ``time_sync`` (offsets between clocks).
"""
