"""Evaluation of a sized device: isometric envelope, force-velocity curves, and the demand of a stride."""
