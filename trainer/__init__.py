"""The trainer: a client that learns to play the games of any joybridge.v1 server. It knows no game's rules."""
