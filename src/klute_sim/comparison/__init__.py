"""Recordings against each other: every stride or repeat on one axis, means with bands, and where they differ."""
