"""The game that `joybridge new` copies."""
