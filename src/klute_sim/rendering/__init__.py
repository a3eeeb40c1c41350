"""Pictures of MuJoCo simulations with their devices: muscles that swell, offscreen or in a window, as images or videos.

Dependence, from the bottom: graphics_context and device_shapes; renderer and window; frames and video.
"""
