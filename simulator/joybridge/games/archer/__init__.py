"""Archer: a small game of an axis and masked choices at once, for teaching and tests."""
