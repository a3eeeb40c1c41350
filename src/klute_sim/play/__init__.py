"""Watch and steer a simulation: gait rig, tester or predicted walk, in a window with keys or as a video.

Dependence, from the bottom: controls; session; window_loop and recording.
"""
