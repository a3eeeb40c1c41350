"""The muscle-tendon unit as a device: its file, its implicit time step, its energy balance and its backends.

From bottom to top: ``dynamics`` (parameters, state, time step), ``delay``, ``backend`` (packing, compilation),
``energy``, ``rollout`` and ``recorded_rollout`` (simulation without MuJoCo), ``batch_outputs``; separately, ``schema``
(sections of a device file) and ``device`` (load, change and save a device).
"""
