"""Orchard: a small game of buttons alone, for teaching and tests."""
