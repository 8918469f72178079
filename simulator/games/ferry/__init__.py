"""Ferry: a small game of two behaviours, for teaching and tests."""
