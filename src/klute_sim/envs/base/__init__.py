"""What all environments share: Gymnasium's rules for calls, values, copies and threads, and the pictures.

Dependence, from the bottom: errors and task; validation and thread_guard; single and vector; batch_vector;
scheduled.
"""
