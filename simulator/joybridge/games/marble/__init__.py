"""Marble: a small game of axes alone, for teaching and tests."""
