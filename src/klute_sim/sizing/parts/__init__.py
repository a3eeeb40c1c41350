"""Sizing rules of the components: actuator, damper, tendon and pressure profile; limits checks their inputs."""
