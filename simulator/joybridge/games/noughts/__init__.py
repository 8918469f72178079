"""Noughts: a small game of two that take turns, for teaching and tests."""
