"""Train a control policy by reinforcement learning (Stable-Baselines3, extra 'rl') and evaluate it.

Order of dependence: ``config`` (the TOML file), ``vec_env`` (the environments), ``training`` (a resumable training),
``evaluate`` (policy against the hand-tuned profile).
"""
