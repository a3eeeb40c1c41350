"""Sizing actuator, damper and tendon for a muscle or a walker (dissertation chapters 4-6)."""
