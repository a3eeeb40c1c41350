"""Train a control policy by reinforcement learning (Stable-Baselines3, extra 'rl') and evaluate it.

Order of dependence: ``environments`` (what can be trained in), ``config`` (the TOML file), ``vec_env`` (the
environments for Stable-Baselines3), ``training`` (a resumable training), ``evaluate`` (policy against baseline).
"""
