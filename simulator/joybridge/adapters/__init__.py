"""Environments of Gymnasium and PettingZoo, and players of Unity ML-Agents, as games.

The modules here are imported only when one is asked for.
"""
