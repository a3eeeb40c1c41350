"""Recordings of results for the rerun viewer, and pictures of these recordings without a screen.

``stream`` writes recordings; ``chart``, ``heatmap`` and ``scene`` are kinds of views; ``layouts`` has one module for
each kind of result; ``folders`` finds or makes the recording of a folder; ``window`` opens the viewer; ``picture``
renders recordings.
"""
