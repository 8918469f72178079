"""Grids of training runs: configurations times seeds, on this machine or on a Ray cluster."""
