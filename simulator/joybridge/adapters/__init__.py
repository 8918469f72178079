"""Environments of Gymnasium and PettingZoo as games. The modules here are imported only when one is asked for."""
