"""What all environments share: Gymnasium's rules for calls, values, copies and threads, and the pictures.

Dependence, from the bottom: errors; validation, thread_guard and rendering; single and vector.
"""
