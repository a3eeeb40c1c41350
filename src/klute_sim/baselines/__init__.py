"""The baselines for a new controller or device: passive feet, simple, tuned and trained controllers.

``library`` loads the shipped baselines; ``table`` plans their runs in five walking conditions and tabulates them.
"""
