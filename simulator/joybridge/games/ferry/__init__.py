"""Ferry: a small game with two behaviors."""
