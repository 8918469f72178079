"""`joybridge mlagents`: a game under a trainer of ML-Agents. It plays the part of the Unity player. No torch."""

from joybridge.cli import Command

COMMAND = Command("joybridge.mlagents_player.command", "simulator", "let a trainer of Unity ML-Agents train a game")
