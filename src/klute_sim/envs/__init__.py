"""Gymnasium environments; importing klute_sim registers them."""
