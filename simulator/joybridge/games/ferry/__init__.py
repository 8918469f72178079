"""Ferry: a small game of two behaviors, for teaching and tests."""
