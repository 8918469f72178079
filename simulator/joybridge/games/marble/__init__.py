"""Marble: a small game with continuous actions only."""
