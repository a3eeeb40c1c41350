"""What all environments share: Gymnasium's rules for calls, values, copies and threads, and the pictures.

Dependence, from the bottom: errors and task; validation, thread_guard and rendering; single and vector; batch_vector;
scheduled.
"""
