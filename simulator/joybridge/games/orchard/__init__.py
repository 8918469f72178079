"""Orchard: a small game with discrete actions only."""
