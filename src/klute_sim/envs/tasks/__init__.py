"""Tasks of the environments: actions, instruments, reward, energy accounting and domain randomisation.

Dependence, from the bottom: actions, reward, instruments, energy_accounting and domain_randomization; options;
gait_task, bench_task, joint_task and the package walk.
"""
