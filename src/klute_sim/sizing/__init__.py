"""Sizing of actuators, damper and tendon for a muscle or a walker (dissertation chapters 4-6).

Dependence, from the bottom: choices and target; parts (how each component is sized); evaluation (what the sized device
does); device_file; sizing (the whole design); sensitivity; summary.
"""
