"""Noughts and crosses: a small turn-based game for two agents."""
