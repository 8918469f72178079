"""Archer: a small game with a continuous action and masked choices."""
