"""One trial file of any kind: its columns, and the channels that follow from them.

In order of dependence: ``heading`` and ``text`` (delimited text), ``sources`` (any kind of file), ``expressions``
(of ``[columns]``), ``column_assignment`` (columns of each channel) and ``table`` (channels in SI).
"""
