"""Training a policy in the walking environment, and comparing it with the hand-tuned profile."""
